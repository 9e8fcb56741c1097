"""Folders under an ECU that log setpoint and position alone, and how far what a fit states of them is from the truth.

Each holds two logs of independent, which shares no code with the model: one with steps as its setpoint and one
with slow ramps, 1.5 s each at 500 Hz, sampled at ticks of an ECU of 1 ms. It is fitted with its gains known, known up
to a scale, and free. With known gains what the plate feels in volts is judged; without, the ratios of it, and whether
all that has no scale is called not identifiable. A fit that ends as a compromise states no standard error.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from independent import Bench, Truth
from independent.control import Computer
from independent.folder import rig_toml
from independent.under_ecu import Log, add_logs

GAINS = {"K_p": 6.0, "K_i": 40.0, "K_d": 0.12}  # of the ECU, SI
LOGS, DURATION = ("steps", "ramps"), 1.5  # s each
CASES: dict[str, Mapping[str, str]] = {
    "known": {"P": "6.0", "I": "40.0", "D": "0.12"},
    "scaled": {key: f'{{ value = {value}, scale = "free" }}' for key, value in (("P", 5.0), ("I", 45.0), ("D", 0.1))},
    "free": dict.fromkeys("PID", '"free"'),
}
VOLTS = ("V_f", "V_s", "V_w", "V_PL")
RATIOS = (("V_s", "V_f"), ("V_w", "V_f"), ("K_p", "V_f"), ("K_i", "K_p"), ("K_d", "K_p"))
WIDEST = 0.5  # standard error of the logarithm of a ratio above which nothing is stated


def write(path: Path, truth: Truth, seed: int, case: str) -> None:
    """The folder of a seed with the gains told as the case says."""
    plain = rig_toml("synthetic, under its ECU", truth.N, Bench(), [], noise=True)
    ecu = "".join(f"{key} = {value}\n" for key, value in CASES[case].items())
    path.mkdir(parents=True, exist_ok=True)
    text = f'{without_inductance(plain)}\n[ecu]\n{ecu}unit = "V/rad"\nperiod_ms = 1.0\n'
    (path / "rig.toml").write_text(text, encoding="utf-8")
    add_logs(path, truth, Computer(*GAINS.values()), seed, kinds=LOGS, how=Log(duration=DURATION))


def without_inductance(text: str) -> str:
    """rig.toml of a folder that has no such test."""
    return text.replace('[tests.inductance]\nseries_ohm = "free"\n', "")


def in_volts(truth: Truth) -> dict[str, float]:
    """What the plate feels, in volts at the terminals."""
    volts = {"V_f": truth.T_f, "V_s": truth.K_s, "V_PL": truth.T_PL}
    speed = truth.B_eq * truth.volts_for(1.0) + truth.N * truth.K_b
    return {**{s: truth.volts_for(torque) for s, torque in volts.items()}, "V_w": speed}


def errors(result: Any, truth: Truth, case: str) -> tuple[dict[str, float | None], list[str]]:
    """z = (found - true)/standard error of each volt or ratio, None where nothing is stated; and what is told a scale
    that no gain gives."""
    from etcfit.estimation.intervals import intervals, lumped

    stated, true = {**lumped(result), **intervals(result)}, in_volts(truth) | GAINS
    if case == "known":
        return {s: _z(stated[s].value - true[s], stated[s].stderr) for s in VOLTS}, []
    z = {f"{a}/{b}": _ratio(result, a, b, true[a] / true[b]) for a, b in RATIOS}
    return z, [s for s in (*VOLTS, *GAINS, "T_f", "K_s", "T_PL") if stated[s].stderr]


def _z(miss: float, stderr: float | None) -> float | None:
    return miss / stderr if stderr else None


def _ratio(result: Any, a: str, b: str, true: float) -> float | None:
    """z of the logarithm of a ratio, by central differences through the fit's own covariance."""
    from etcfit.estimation.intervals import LUMPS

    layout, held = result.free_parameters.layout, result.free_parameters.held
    if result.compromise is not None:
        return None

    def log(x: np.ndarray) -> float:
        values, n = layout.values(x, held), result.rig.config.gear_ratio
        top, bottom = (float(LUMPS[s].formula(values, n) if s in LUMPS else values[s]) for s in (a, b))
        return float(np.log(top / bottom))

    steps = 1e-4 * np.eye(result.x.size)
    gradient = np.array([(log(result.x + h) - log(result.x - h)) / 2e-4 for h in steps])
    sd = float(np.sqrt(gradient @ result.covariance @ gradient))
    return None if sd > WIDEST else (log(result.x) - float(np.log(true))) / sd
