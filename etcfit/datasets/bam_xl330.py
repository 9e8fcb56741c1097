"""An XL330 geared DC servo that swings a pendulum, of the BAM (better actuator models) recordings."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from .base import Dataset, Source, csv_text, licence_text, on_github

_FULL_DUTY = 885  # PWM counts
_LOGGED = {"time [s]": "timestamp", "duty [%]": "load", "supply [V]": "input_volts", "position [rad]": "position",
           "setpoint [rad]": "goal_position", "temperature [degC]": "temp"}  # fmt: skip
_COMMIT = "af2260462471ff45ac18af159b1327ea51d8db15"


def _source(moment: str, sha256: str) -> Source:
    name = f"2026-01-15_{moment}.json"
    return Source(f"bam_xl330/raw/{name}", on_github("Rhoban/bam", _COMMIT, f"bam/data.bak/raw/{name}"), sha256)


_SOURCES = (
    _source("10h28m10", "e58f3c2a08a5e0e37a2c5e930d0830a438bc102b8d21482767124f495b92f2ce"),
    _source("10h28m17", "ef6507934ba465eb31529d7d98715ecc70bd5c87be049fd4618a94ce39290569"),
    _source("10h28m24", "165b171df12b3e8b39504ce36d37e373ad105c0dddf4d3d073c747fd492e8bef"),
    _source("10h28m32", "fdc255edae6995298af437f37582eb8cd0c4a5ddcec4f49fb7c4d6f3303aaa9c"),
    _source("10h29m14", "016d15d21c464457aa30eaeab3977228b08cd5acf7542f24067440126c0bf480"),
    _source("10h29m21", "fe68cff62e976c87a2fcab925a517fbff83be16c862693310fdc1eff743eddab"),
    _source("10h29m29", "b9ce9fc0f396e6b03bd514e9254cb83b8a64e1a5df1728b9a10e3b4a5a9513ca"),
    _source("10h29m37", "838d390b7190c4ce1608157cf629989648773b7336728a0931a61c6018c6700b"),
)

_RIG = """\
[rig]
name = "XL330 servo with pendulum (BAM recordings)"
travel_deg = [-inf, inf]     # the arm swings freely; 0 is hanging down
# gear_ratio is left out: motor quantities are then those seen at the output shaft

[noise]
position_rad = 4.4e-4        # encoder: 4096 counts a turn, one count over sqrt(12)
duty = 0.0003                # a command, exact to one count of 885: 0.0011 over sqrt(12)

[parameters]
K_s = { fixed = 0.0 }        # no spring
T_PL = { fixed = 0.0 }
J_m = { fixed = 1e-9 }       # rotor and arm turn as one: all inertia is J_L; a rotor has some
B_m = { fixed = 0.0 }        # and all viscous friction is B_L
T_g = 0.48                   # 0.49 kg * 9.81 m/s2 * 0.10 m; the arm's own mass, not logged, comes on top
J_L = 0.005                  # 0.49 kg * (0.10 m)^2, without arm and rotor

[model]
effects = ["gravity_load"]

[holdout]
files = ["response/kp100_sin_time_square.csv", "response/kp400_sin_sin.csv"]
"""

_README = f"""\
# XL330 servo with a pendulum (BAM recordings)

Measured on a Dynamixel XL330 geared DC servo that swings 0.49 kg at 0.10 m: position gains 100 and 400, four
trajectories each, 6 s a run, irregularly sampled at about 186 Hz.

- Sources: GitHub `Rhoban/bam`, commit `{_COMMIT}`, `bam/data.bak/raw/`
- Licence: Apache-2.0, see `LICENSE`.
- Cite: M. Duclusaud, G. Passault, V. Padois, O. Ly, *Extended Friction Models for the Physics Simulation of Servo
  Actuators*, arXiv 2410.08650.

Converted by `etcfit fetch bam-xl330`; nothing is filtered or resampled.

- `duty [%]` is `load`, a PWM count in unsigned 16 bit (65536 taken off above 32767) over 885; positive duty raises
  the position, as it stands. The voltage at the motor is duty times `supply [V]`.
- `supply [V]` is `input_volts`, logged in steps of 0.1 V. It swings between 5.8 and 9.2 V, also while the arm stands
  still, so part of it is the moment within the PWM period at which it was sampled.
- `position [rad]` counts from hanging down; `setpoint [rad]` is `goal_position`; `temperature [degC]` is `temp`.
- `speed` is left out: it is the servo's own estimate, about 20 ms late.
- In `lift_and_drop` the torque goes off after 2 s. `response/` has the run up to there; what follows, with open
  terminals and the arm let go, lies in `inertia/` with time and position only. Time is the run's.

Held out, one run of each gain and two different trajectories: kp 100 `sin_time_square`, kp 400 `sin_sin`.

There is no current: resistance and motor constant cannot be told apart. The arm's own mass is not known.
"""


def signed_duty(load: np.ndarray) -> np.ndarray:
    """duty = load/885, -1 to 1, where load is a signed PWM count logged as unsigned 16 bit, shape (n,)."""
    return np.where(load > 32767, load - 65536, load) / _FULL_DUTY


def _columns(entries: list[dict], *headers: str) -> dict[str, np.ndarray]:
    columns = {header: np.array([entry[_LOGGED[header]] for entry in entries], dtype=float) for header in headers}
    if "duty [%]" in columns:
        columns["duty [%]"] = 100.0 * signed_duty(columns["duty [%]"])
    return columns


def _traces(file: Path) -> Iterator[tuple[str, str]]:
    """One run as one trace, or two where the torque goes off within it."""
    run = json.loads(file.read_text(encoding="utf-8"))
    name, entries = f"kp{run['kp']}_{run['trajectory']}.csv", run["entries"]
    off = next((k for k, entry in enumerate(entries) if not entry["torque_enable"]), len(entries))
    yield f"response/{name}", csv_text(f"{file.name}, torque on", _columns(entries[:off], *_LOGGED))
    if off < len(entries):
        yield f"inertia/{name}", csv_text(f"{file.name}, from torque off: terminals open",
                                            _columns(entries[off:], "time [s]", "position [rad]"))  # fmt: skip


def _convert(files: Mapping[str, Path]) -> dict[str, str]:
    traces = dict(trace for source in _SOURCES for trace in _traces(files[source.local]))
    return {"rig.toml": _RIG, "README.md": _README, "LICENSE": licence_text("bam_xl330"), **traces}


BAM_XL330 = Dataset("bam-xl330", "a geared DC servo swings a pendulum: duty, supply and position", _SOURCES, _convert)
