"""The throttle valve of the University of Kassel: duty in, position sensor volts out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .base import Dataset, Source, csv_text, licence_text, on_github, read_vectors

_PERIOD = 0.010  # s, as in the authors' script
_FITTED = 0.6  # of the record; the rest is held out

_SOURCE = Source(
    local="kassel_throttle/Throttle1.mat",
    url=on_github("MRT-RT/TS_Toolbox", "50938d18ccf2b84959d90fe7a424c4e3ac998096", "Examples/Data/Throttle1.mat"),
    sha256="86ea31f72b1c5e8e39df43c0c8e85bac66ac68d3fc38954bb9ee64775079a663",
)

_RIG = """\
[rig]
name = "Kassel throttle valve (make unknown)"
supply_V = 12.0              # nominal: the authors do not state it, so volts and torques have no absolute scale
travel_deg = [0.0, 90.0]     # nominal: the angle between the stops is not stated either
# gear_ratio is not known and left out: motor quantities are then those seen at the plate

# Larger duty drives the sensor voltage down. Angle is counted from the closed side, so that duty opens.
[tps]
closed_V = 4.59              # highest reading, against the stiff second spring on the closed side
open_V = 0.702               # far end stop
travel_deg = 90.0            # nominal, as above

[noise]
tps_V = 0.0006               # rms at rest; 0.4 to 0.8 mV from one rest to the next
duty = 0.0003                # a command, exact to its step of 0.1 %: 0.001 over sqrt(12)

[holdout]
files = ["response/holdout.csv"]
"""

_README = f"""\
# Kassel throttle valve

Measured on a real automotive throttle valve at the University of Kassel, Department of Measurement and Control.

- Source: `Throttle1.mat`, {_SOURCE.url}
- Licence: BSD-3-Clause, see `LICENSE`.
- Cite: A. Dürrbaum, *Takagi-Sugeno Model Identification Toolbox*, University of Kassel, 2021.

Converted by `etcfit fetch kassel-throttle`: 2498 samples at 10 ms of `u`, written as `duty [%]`, and `y`, written as
`tps [V]`; nothing is filtered or left out. `response/fit.csv` is the first 60 % of the record, `response/holdout.csv`
the last 40 %, never fitted; its time goes on where the first ends.

Assumed, because the authors do not state it: `u` is a signed PWM duty in percent, `y` the volts of the position
sensor, the supply 12 V and the angle between the stops 90 degrees. Make and gear ratio are unknown.

Seen in the data: rest (limp-home) at 4.42 V; on the closed side a stiff second spring up to 4.59 V; far end stop at
0.702 V; sensor quantum 0.322 mV.

There is no current and no speed, and the mechanical time constant is about one sample: inertia, inductance and the
absolute scale of torque cannot be identified from this record.
"""


def _convert(files: Mapping[str, Path]) -> dict[str, str]:
    duty, tps = read_vectors(files[_SOURCE.local], "u", "y")
    columns = {"time [s]": _PERIOD * np.arange(duty.size), "duty [%]": duty, "tps [V]": tps}
    cut = int(_FITTED * duty.size)
    parts = {"fit": slice(None, cut), "holdout": slice(cut, None)}
    traces = {
        f"response/{name}.csv": csv_text(
            f"Kassel throttle valve, {name} part of Throttle1.mat; units as assumed in README.md",
            {header: values[part] for header, values in columns.items()},
        )
        for name, part in parts.items()
    }
    return {"rig.toml": _RIG, "README.md": _README, "LICENSE": licence_text("kassel_throttle"), **traces}


KASSEL_THROTTLE = Dataset(
    "kassel-throttle",
    "a real automotive throttle valve, University of Kassel: duty and sensor volts",
    (_SOURCE,),
    _convert,
)
