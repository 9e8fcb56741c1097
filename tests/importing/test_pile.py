"""From a pile of recordings to gains on a simulated ECU, by four commands, as a person with a bench would."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import foreign
from independent import NONE, Truth, draw_truth, make_folder
from independent.control import Computer, Score, noisy, score, trapezoids
from independent.simulate import throttle

SEED = 7801  # a training seed
DIALECTS: tuple[tuple[str, Callable[[Path, foreign.Columns], Path]], ...] = (
    ("mat", foreign.matlab_5), ("mf4", foreign.mdf4), ("tdms", foreign.tdms), ("parquet", foreign.parquet),
    ("lvm", foreign.labview),
)  # fmt: skip
TRAVEL = np.pi / 2


def pile(folder: Path, bench: Path) -> list[str]:
    """Each trace as another program wrote it, its columns as the bench calls them; five dialects in turn."""
    files = sorted(bench.rglob("*.csv"))
    for k, file in enumerate(files):
        header, *rows = file.read_text().splitlines()[1:]
        cells = np.array([[float(cell) for cell in row.split(",")] for row in rows])
        named = [name[:-1].partition(" [") for name in header.split(",")]
        columns = {name: (unit, values) for (name, _, unit), values in zip(named, cells.T, strict=True)}
        columns["time"] = ("s", {"s": 1.0, "ms": 1e-3}[columns["time"][0]] * columns["time"][1])
        ending, write = DIALECTS[k % len(DIALECTS)]
        write(folder / f"{file.parent.name}_{file.stem}.{ending}", columns)
    return [str(path) for path in sorted(folder.iterdir())]


@pytest.mark.slow
def test_thirty_recordings_become_gains_that_hold_by_four_commands(tmp_path: Path) -> None:
    truth = draw_truth(np.random.default_rng(SEED))
    make_folder(tmp_path / "bench", truth, SEED, NONE, declare_noise=False, holdout=False)
    (tmp_path / "pile").mkdir()
    files = pile(tmp_path / "pile", tmp_path / "bench")
    assert len(files) == 30
    folder, run = str(tmp_path / "mine"), str(tmp_path / "run")
    commands = [
        ["import", *files, "--to", folder, "--rig", str(tmp_path / "bench" / "rig.toml"), "--yes"],
        ["fit", folder, "--out", run],
        ["design", run, "--ecu", "rusefi"],
        ["export", run, "--to", "c", "--out", str(tmp_path / "c")],
    ]
    for command in commands:
        begun = time.perf_counter()
        done = subprocess.run([sys.executable, "-m", "etcfit.cli", *command, "--quiet"], text=True, capture_output=True,
                              check=False)  # fmt: skip
        assert done.returncode == 0, done.stderr
        print(f"{command[0]}: {time.perf_counter() - begun:.0f} s")
    found = json.loads((tmp_path / "run" / "pid.json").read_text())
    assert all(found["met"].values())
    real = on_the_throttle(truth, found)
    promised = found["scenarios"]["trapezoid"]
    assert real.rmse == pytest.approx(promised["rmse_pct"], rel=0.03)
    assert real.overshoot == pytest.approx(promised["overshoot_pct"], abs=1.0)
    assert real.settling == pytest.approx(promised["settling_s"], abs=0.01)


def on_the_throttle(truth: Truth, found: Mapping[str, Any]) -> Score:
    """The paper's trapezoid with the proposed gains, on the throttle itself under a computer of the generator's own."""
    ecu, gains = found["ecu"], found["gains"]
    limits = {"supply": ecu["duty_limit"] * ecu["supply_V"], "hold": ecu["integral_limit"] * ecu["supply_V"]}
    habits = {"filter": ecu["derivative_filter_s"], "delay": ecu["delay_s"], "noise": ecu["noise_rad"]}
    computer = Computer(gains["Kp"], gains["Ki"], gains["Kd"], period=ecu["period_s"], grain=ecu["resolution_rad"],
                        **limits, **habits)  # fmt: skip
    wanted = trapezoids(0.05 * TRAVEL, 0.45 * TRAVEL, ecu["period_s"])
    path = noisy(throttle(truth, NONE), computer, wanted, np.random.default_rng(SEED))
    return score(path[:, 0], wanted, ecu["period_s"], TRAVEL)
