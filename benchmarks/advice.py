"""What one more trace is said to tell against what it tells: intervals predicted and found, over many folders.

    python -m benchmarks.advice --folders 20 --first-seed 100

Each folder comes from independent, which shares no code with the model: the paper's rig with its parameters drawn
+-40 %, one rig test left out, another from folder to folder. It is fitted; `etcfit check --advise --at RUN` is asked
there, the best trace that is no repetition is made as planned by the independent generator, and all is fitted again.
Predicted and found are sd after / sd before of each coordinate. A parameter that was not determined before (no better
than to 30 %) has no interval that could shrink, and is not counted.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from independent import CONSISTENT, NONE, Bench, draw_truth
from independent.folder import SIZES, write_folder, write_trace
from independent.planned import record
from independent.protocols import Session

LEFT_OUT = ("viscous", "static_load", "inductance", "inertia")
FACTOR = 2.0  # within which predicted and found are said to agree
SHRINKS = 0.9  # share below which an interval is predicted to shrink at all


@dataclass(frozen=True)
class Outcome:
    """One folder: the trace advised, and for each parameter the shares of its interval predicted and found."""

    seed: int
    left_out: str
    advised: str
    converged: bool
    predicted: dict[str, float]
    found: dict[str, float]

    def __str__(self) -> str:
        off = max(self.predicted, key=lambda s: abs(np.log(self.found[s] / self.predicted[s])))
        return (f"seed {self.seed}, without {self.left_out}: {self.advised}; converged {self.converged}, furthest off "
                f"{off}, predicted {self.predicted[off]:.3f}, found {self.found[off]:.3f}")  # fmt: skip


def one(seed: int, left_out: str, scratch: Path) -> Outcome:
    """Draw, fit, ask, make what was advised, fit again."""
    from etcfit.estimation.joint_fit import fit
    from etcfit.experiment.advice import advise
    from etcfit.rig.reader import read_folder

    before, after = scratch / "before", scratch / "after"
    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    sizes = {name: series for name, series in SIZES["small"].items() if name != left_out}
    write_folder(before, f"seed {seed}", truth, seed, NONE, sizes, Bench(), holdout=False, noise=True)
    first = fit(read_folder(before))
    option = next(o for o in advise(first.rig, first).options if not o.again)
    plan = option.plan
    assert plan is not None, "an option that is no repetition is planned"

    shutil.copytree(before, after)
    (after / plan.test).mkdir(exist_ok=True)
    session = Session(np.random.default_rng(1_000_000 + seed), truth, NONE, Bench())
    write_trace(after, record(session, plan.test, plan.time, plan.volts, plan.release), seed)
    second = fit(read_folder(after))
    return compared(seed, left_out, option, first, second)


def compared(seed: int, left_out: str, option: Any, first: Any, second: Any) -> Outcome:
    """Of what was determined before."""
    symbols, lost = first.free_parameters.layout.free, first.identifiability.lost
    sd = [dict(zip(symbols, np.sqrt(np.diag(result.covariance)), strict=True)) for result in (first, second)]
    told = [s for s in symbols if s not in lost]
    predicted = dict(zip(symbols, option.shrinks, strict=True))
    return Outcome(
        seed,
        left_out,
        f"{option.test}, {option.says}",
        first.converged and second.converged,
        {s: float(predicted[s]) for s in told},
        {s: float(sd[1][s] / sd[0][s]) for s in told},
    )


def table(outcomes: list[Outcome]) -> str:
    """A line a parameter."""
    lines = [
        "| parameter | folders | predicted, median | found, median | found / predicted, median | least | most |",
        "|---|---|---|---|---|---|---|",
    ]
    every = np.empty((0, 2))
    for symbol in dict.fromkeys(s for o in outcomes for s in o.predicted):
        pairs = np.array([(o.predicted[symbol], o.found[symbol]) for o in outcomes if symbol in o.predicted])
        ratio = pairs[:, 1] / pairs[:, 0]
        every = np.vstack((every, pairs))
        figures = (*np.median(pairs, axis=0), np.median(ratio), ratio.min(), ratio.max())
        lines.append(f"| {symbol} | {len(pairs)} | " + " | ".join(f"{f:.3f}" for f in figures) + " |")
    shrinking = every[every[:, 0] < SHRINKS]
    folders = f"{len(outcomes)} folders, {sum(o.converged for o in outcomes)} converged twice"
    less = f"of those predicted to shrink below {SHRINKS:g}: {agreement(shrinking)}"
    return "\n".join(lines) + f"\n\n{folders}; {agreement(every)}; {less}"


def agreement(pairs: np.ndarray) -> str:
    """Of predicted and found, shape (K, 2)."""
    ratio = pairs[:, 1] / pairs[:, 0]
    inside = np.abs(np.log(ratio)) < np.log(FACTOR)
    near = np.abs(ratio - 1.0) < 0.1
    return (f"{len(pairs)} pairs, {100.0 * np.mean(inside):.1f} % within a factor of {FACTOR:g}, "
            f"{100.0 * np.mean(near):.1f} % within 10 %")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folders", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=100)
    choices = parser.parse_args()
    from etcfit.backend import use_compilation_cache

    use_compilation_cache()
    outcomes, began = [], time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        for k in range(choices.folders):
            seed = choices.first_seed + k
            outcomes.append(one(seed, LEFT_OUT[k % len(LEFT_OUT)], Path(scratch) / str(seed)))
            print(f"{outcomes[-1]} ({time.process_time() - began:.0f} s cpu so far)", flush=True)
    print(f"\n{table(outcomes)}")


if __name__ == "__main__":
    main()
