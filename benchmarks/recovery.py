"""Recovery of known parameters: the joint fit against the paper's reading over many folders of independent data.

    python -m benchmarks.recovery --centre consistent --folders 40 --first-seed 1000

Each folder comes from independent, which shares no code with the model, with true parameters drawn +-40 % around
a centre: CONSISTENT (the paper's own J_eq = 0.0012 kg m2) or TABLE_2 (as printed, J_m = 1e-4, hence J_eq = 0.044).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from independent import CONSISTENT, TABLE_2, Bench, draw_truth, make_folder

CENTRES = {"consistent": CONSISTENT, "table2": TABLE_2}
PAPER = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
SERIES = "series_ohm.inductance"


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One folder: for each parameter truth, reading, fit, stated interval and the Cramer-Rao bound at the truth."""

    seed: int
    converged: bool
    seconds: float
    truth: dict[str, float]
    reading: dict[str, float]
    fit: dict[str, float]
    stderr: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]
    bound: dict[str, float]
    chi2: float


def one(seed: int, centre: str, folder: Path) -> Outcome:
    """Draw, simulate, fit."""
    from etcfit.estimation.intervals import intervals
    from etcfit.estimation.joint_fit import fit
    from etcfit.rig.reader import read_folder

    truth = draw_truth(np.random.default_rng(seed), CENTRES[centre])
    make_folder(folder, truth, seed)
    rig = read_folder(folder)
    begin = time.perf_counter()
    result = fit(rig)
    seconds = time.perf_counter() - begin
    true = {s: getattr(truth, s) for s in PAPER} | {SERIES: Bench().series_ohm}
    stated = {s: i for s, i in intervals(result).items() if s in true}
    return Outcome(
        seed,
        result.converged,
        seconds,
        true,
        {s: result.readings.values.get(s, float("nan")) for s in true},
        {s: stated[s].value for s in true},
        {s: _number(stated[s].stderr) for s in true},
        {s: _number(stated[s].low) for s in true},
        {s: _number(stated[s].high) for s in true},
        _bound(result, true),
        result.chi2_per_dof,
    )


def _number(known: float | None) -> float:
    """A parameter called not identifiable has no interval, and none that covers."""
    return float("nan") if known is None else known


def _bound(result: Any, truth: dict[str, float]) -> dict[str, float]:
    """Cramer-Rao bound at the truth for the noise put in, that of the voltage included: (J^T J)^-1 of the residual
    whitened along the true path, with every input sample, edge, release and start a nuisance of its own."""
    import jax

    problem = result.problem
    layout = problem.layout
    x = layout.coordinates(truth)
    weighted = problem.weighted(problem.kalman(x))
    jacobian = problem.linearise(x, weighted).jacobian
    flat = jacobian.reshape(-1, x.size)
    sd = np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)))
    slope = [float(jax.grad(layout.parameter(s).domain.value)(x[k])) for k, s in enumerate(layout.free)]
    return {s: abs(slope[k]) * float(sd[k]) for k, s in enumerate(layout.free) if s in truth}


def table(outcomes: list[Outcome]) -> str:
    """The figures the issue asks for, a line a parameter."""
    head = (
        "parameter",
        "median error %",
        "max error / stated s.e.",
        "coverage %",
        "reading median %",
        "gain",
        "rms / CRB",
    )
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    every, gains = [], []
    for s in (*PAPER, SERIES):
        truth, fit, reading, se, bound = (
            np.array([getattr(o, name)[s] for o in outcomes]) for name in ("truth", "fit", "reading", "stderr", "bound")
        )
        low, high = (np.array([getattr(o, name)[s] for o in outcomes]) for name in ("low", "high"))
        inside = (low <= truth) & (truth <= high)
        every.append(inside)
        error, base = np.abs(fit / truth - 1.0), np.abs(reading / truth - 1.0)
        gain = base / np.maximum(error, 1e-12)
        gains.append(gain[np.isfinite(gain)])
        rms = np.sqrt(np.mean(((fit - truth) / bound) ** 2))
        z = np.abs(fit - truth) / se
        cells = (
            f"{100 * np.median(error):.4f}",
            f"{np.nanmax(z):.2f}",
            f"{100 * inside.mean():.1f}",
            f"{100 * np.nanmedian(base):.3f}",
            f"{np.nanmedian(gain):.1f}",
            f"{rms:.2f}",
        )
        lines.append(f"| {s} | " + " | ".join(cells) + " |")
    pairs, gain = np.concatenate(every), np.concatenate(gains)
    unstated = sum(all(np.isnan(se) for se in o.stderr.values()) for o in outcomes)
    lines.append("")
    lines.append(
        f"{len(outcomes)} folders, {sum(o.converged for o in outcomes)} converged; intervals cover "
        f"{100 * pairs.mean():.1f} % of {pairs.size} pairs; median gain over the reading {np.median(gain):.1f}; "
        f"chi2/dof {np.mean([o.chi2 for o in outcomes]):.4f} mean; "
        f"{np.median([o.seconds for o in outcomes]):.1f} s a fit; {unstated} without standard errors (a compromise)"
    )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--centre", choices=CENTRES, default="consistent")
    parser.add_argument("--folders", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--save", type=Path, help="append each outcome to this file as a line of JSON")
    parser.add_argument("--table", type=Path, help="fit nothing: the table of what was saved in this file")
    choices = parser.parse_args()
    if choices.table:
        print(table([Outcome(**json.loads(line)) for line in choices.table.read_text().splitlines()]))
        return
    outcomes = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(choices.first_seed, choices.first_seed + choices.folders):
            outcomes.append(one(seed, choices.centre, Path(scratch) / str(seed)))
            worst = max(abs(outcomes[-1].fit[s] / v - 1.0) for s, v in outcomes[-1].truth.items())
            last = outcomes[-1]
            print(
                f"seed {seed}: {last.seconds:.1f} s, converged {last.converged}, worst {100 * worst:.2f} %", flush=True
            )
            if choices.save:
                with choices.save.open("a") as file:
                    file.write(json.dumps(dataclasses.asdict(last)) + "\n")
    print(table(outcomes))


if __name__ == "__main__":
    main()
