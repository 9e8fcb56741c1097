"""Folders with logs under an ECU, made by the independent generator, its gains known or free."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from etcfit.rig.base import Rig
from etcfit.rig.reader import read_folder
from independent import Bench, Truth, draw_truth, make_folder
from independent.control import Computer
from independent.effects import NONE, Effects
from independent.folder import rig_toml
from independent.under_ecu import Log, add_logs

GAINS = {"K_p": 6.0, "K_i": 40.0, "K_d": 0.12}
COMPUTER = Computer(*GAINS.values())
FREE = '\n[ecu]\nP = "free"\nI = "free"\nD = "free"\nperiod_ms = 1.0\n'
KNOWN = '\n[ecu]\nP = 6.0\nI = 40.0\nD = 0.12\nunit = "V/rad"\nperiod_ms = 1.0\n'


def under_ecu(
    path: Path, seed: int, gains: str, problem: bool, effects: Effects = NONE, how: Log | None = None
) -> tuple[Truth, Rig]:
    """Three logs, the last held out: trapezoids, a sum of sines, strokes of a pedal; beside the bench tests or not."""
    truth = draw_truth(np.random.default_rng(seed))
    if problem:
        make_folder(path, truth, seed, effects, size="small")
    else:
        plain = rig_toml("synthetic, under its ECU", truth.N, Bench(), ["none"], noise=True)
        path.mkdir(parents=True, exist_ok=True)
        (path / "rig.toml").write_text(plain.replace('[tests.inductance]\nseries_ohm = "free"\n', ""), encoding="utf-8")
    files = add_logs(path, truth, COMPUTER, seed, how=how, effects=effects)
    text = (path / "rig.toml").read_text(encoding="utf-8").replace('"none"', "")
    held = text.replace("files = [", f'files = ["{files[-1]}"' + (", " if problem else "")) + gains
    (path / "rig.toml").write_text(held, encoding="utf-8")
    return truth, read_folder(path)
