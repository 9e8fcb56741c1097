"""EMPS: DC motor, ball screw and sled, the electro-mechanical positioning system benchmark."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import MeasurementError
from .base import Dataset, Source, csv_text, on_github, read_vectors

_PERIOD = 0.001  # s


def _source(name: str, sha256: str) -> Source:
    commit = "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a"
    url = on_github("forgi86/sysid-neural-continuous", commit, f"examples/EMPS/data/{name}")
    return Source(f"emps/{name}", url, sha256)


_TRAINING = _source("DATA_EMPS.mat", "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e")
_PULSES = _source("DATA_EMPS_PULSES.mat", "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704")

_RIG = """\
# A unit-radius pulley makes a straight axis a turning one, exactly: 1 rad is 1 m, 1 N m is 1 N, 1 kg m2 is 1 kg.
[rig]
name = "EMPS, Maxon motor and ball screw (1 rad = 1 m, 1 N m = 1 N)"
travel_deg = [-inf, inf]     # the sled never reaches an end

[noise]
position_rad = 1.7e-8        # encoder quantum 50 nm: 14 nm rms from rounding, 17 nm from third differences
torque_Nm = 0.001            # the controller's output as it was computed: a command, without measurement noise

[parameters]
K_s = { fixed = 0.0 }        # no spring
J_m = { fixed = 1e-9 }       # motor and sled move as one: all inertia is J_L (the mass, kg); a motor has some
B_m = { fixed = 0.0 }        # and all viscous friction is B_L (N s/m)
J_L = 100.0                  # orders of magnitude, only where the fit starts: a throttle's would be far off
B_L = 200.0
T_f = 20.0
# T_PL, free, is the constant offset of the force

[holdout]
files = ["response/pulses.csv"]
"""

_README = f"""\
# EMPS, electro-mechanical positioning system

Measured on a Maxon DC motor that drives a sled through a ball screw, under a PD position loop.

- Sources: `DATA_EMPS.mat`, {_TRAINING.url}
  and `DATA_EMPS_PULSES.mat`, {_PULSES.url}
- Licence: not stated by the authors; a public benchmark. Do not redistribute this folder.
- Cite: A. Janot, M. Gautier, M. Brunot, *Data Set and Reference Models of EMPS*, Workshop on Nonlinear System
  Identification Benchmarks, Eindhoven, 2019.

Converted by `etcfit fetch emps`: 24 841 samples at 1 kHz a file, nothing filtered or left out.

- `torque [N*m]` is the motor force, gtau * vir (gtau = 35.1507 N/V), as if on a pulley of radius 1 m: 1 N m is 1 N.
- `position [rad]` is `qm` and `setpoint [rad]` is `qg`: 1 rad is 1 m.
- `response/training.csv` is fitted; `response/pulses.csv`, the official test set, is held out. Its force pulses
  (5 V) are part of `vir`, so they are part of `torque`.

There is no spring and no current. Inertia and viscous friction of motor and sled are lumped in J_L (kg) and B_L
(N s/m). The positions of the pulses file do not lie on the encoder's grid of 50 nm: its authors have resampled it.
"""


def on_schedule(file: Path, time: np.ndarray) -> None:
    """Refuse a record whose samples are not a period apart.

    Args:
        time: s, shape (n,).
    Raises:
        MeasurementError: it is not the published file.
    """
    steps = np.diff(time)
    if steps.min() < 0.999 * _PERIOD or steps.max() > 1.001 * _PERIOD:
        raise MeasurementError(
            str(file),
            f"its samples are {steps.min():.6g} to {steps.max():.6g} s apart.",
            f"They must be {_PERIOD} s apart.",
            "This is not the published file; fetch it again.",
        )


def _trace(file: Path) -> str:
    time, position, setpoint, volts, gain = read_vectors(file, "t", "qm", "qg", "vir", "gtau")
    on_schedule(file, time)
    columns = {"time [s]": time, "torque [N*m]": gain * volts, "position [rad]": position, "setpoint [rad]": setpoint}
    return csv_text(f"EMPS, {file.name}; 1 rad = 1 m, 1 N m = 1 N", columns)


def _convert(files: Mapping[str, Path]) -> dict[str, str]:
    return {
        "rig.toml": _RIG,
        "README.md": _README,
        "response/training.csv": _trace(files[_TRAINING.local]),
        "response/pulses.csv": _trace(files[_PULSES.local]),
    }


EMPS = Dataset("emps", "a DC motor, ball screw and sled under a PD loop, 1 kHz", (_TRAINING, _PULSES), _convert)
