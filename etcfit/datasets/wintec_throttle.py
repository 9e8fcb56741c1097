"""The throttle body of Wintec: a duty that rises step by step, a bridge that coasts, both sensors' volts out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from .base import Dataset, Source, csv_text, on_github

# a sweep of the duty at each, kHz; of those held out none is fitted
_FITTED = (3, 5, 7, 9, 11)
_HELD_OUT = (4, 6, 8, 10, 12, 15, 18)


def _listed(frequencies: Iterable[int]) -> str:
    return ", ".join(map(str, frequencies))


_SOURCE = Source(
    local="wintec_throttle/calibration.csv",
    url=on_github(
        "OLLYDOTDEV/Throttle_Body_Control_Platform",
        "3e6cc42370fdbdd2eafdd5e8e34c24143d5e3972",
        "CODE/Research_And_Development/C%2B%2B/Calibration/Code/TBCP/Archive/ESP32_TB_Self_Calibration/"
        "Serial%20Recording%200-19000Hz%2012Bits%20-%20TB%20Calibration.csv",
    ),
    sha256="ba58f28d8c7f6837ec1e1f673ab70dc38f27b944e3277914e8567e538a190963",
)

_RIG = f"""\
[rig]
name = "Wintec throttle body (make unknown)"
supply_V = 12.0              # nominal: the authors do not state it, so volts and torques have no absolute scale
travel_deg = [0.0, 90.0]     # nominal: the angle between the stops is not stated either
# gear_ratio is not known and left out: motor quantities are then those seen at the plate

[tps]
closed_V = 0.25              # lowest reading: the plate falls onto a stop there
open_V = 3.97                # where the inverse sensor would read 0.25 V; the plate never gets there
travel_deg = 90.0            # nominal, as above

[noise]
tps_V = 0.01                 # rms at rest
duty = 0.0003                # a command, exact to its step

[holdout]
files = [{", ".join(f'"response/{f:02d}_kHz.csv"' for f in _HELD_OUT)}]
"""

_README = f"""\
# Wintec throttle body

Measured on a real electronic throttle body by students of the Waikato Institute of Technology (Wintec), Oliver Bell and
Piyapat Srisawat, supervised by Mohammad AI-Rawi, on 3 April 2024.

- Source: {_SOURCE.url}
- Licence: the repository's README says MIT; it holds no licence text.

Converted by `etcfit fetch wintec-throttle`: twelve of its nineteen sweeps, one for each frequency of the PWM, about
11 ms a sample by the controller's own clock; of two rows within one millisecond the second is left out. `tps [V]` is
the main sensor. `duty [%]` is rebuilt from the program that made the recording: the command rises from 0 to 100 % by
1 % every 250 ms, and as soon as the main sensor reads no less than the inverse one, the PWM is 0 until the next step.
The sweeps at {_listed(_FITTED)} kHz are fitted, those at {_listed(_HELD_OUT)} kHz are held out.

The PWM acts on the bridge's enable pin: in the off time and after a cut the terminals are open and the motor coasts.

Assumed, because the authors do not state it: supply 12 V, 90 degrees between the stops, the open stop where the inverse
sensor would read what the main one reads when closed. Make and gear ratio are unknown. No current and no speed were
logged: inertia, inductance and the absolute scale of torque cannot be identified from this record.
"""


def _convert(files: Mapping[str, Path]) -> dict[str, str]:
    """Columns of the recording: host's time, ms, main V, inverse V, PWM in Hz, duty in %, and a flag."""
    rows = np.loadtxt(files[_SOURCE.local], delimiter=",", skiprows=1, usecols=range(1, 6), encoding="utf-8")
    sweeps = {f: rows[rows[:, 3] == 1000 * f].T for f in sorted((*_FITTED, *_HELD_OUT))}
    traces = {f"response/{f:02d}_kHz.csv": _trace(f, *sweep) for f, sweep in sweeps.items() if sweep.size}
    return {"rig.toml": _RIG, "README.md": _README, **traces}


def _trace(
    kilohertz: int, ms: np.ndarray, main: np.ndarray, inverse: np.ndarray, _: np.ndarray, duty: np.ndarray
) -> str:
    later = np.diff(ms, prepend=ms[0] - 1.0) > 0.0
    ms, main, inverse, duty = (column[later] for column in (ms, main, inverse, duty))
    crossed = np.maximum.accumulate(np.where(main >= inverse, np.arange(ms.size), -1))  # last row where they did
    columns = {
        "time [s]": (ms - ms[0]) / 1000.0,
        "duty [%]": np.where(crossed >= np.searchsorted(duty, duty), 0.0, duty),  # since the step began: cut
        "tps [V]": main,
    }
    return csv_text(f"Wintec throttle body, sweep at {kilohertz} kHz; duty rebuilt as said in README.md", columns)


WINTEC_THROTTLE = Dataset(
    "wintec-throttle",
    "a real automotive throttle body, Wintec: duty of a bridge that coasts and sensor volts",
    (_SOURCE,),
    _convert,
)
