"""`etcfit fit` cold and warm on a folder of 30 traces and some 68,000 samples, against the same problem by SciPy.

    python -m benchmarks.bench_fit [--repeats 3] [--trials 2]

Cold: a fresh process, an empty cache of compiled models, a run folder that is not there. Warm: the same cache, twice
more. All in one run, side by side, each repeat printed; the table holds medians. `wall` counts whatever else the
machine did meanwhile, `cpu` (user + system) does not. SciPy gets its Jacobian by differences: it is timed on all
fitted traces for a few trial points and scaled to as many Jacobians as etcfit computed, which the output states.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import scipy_twin
from .plain import plain
from .runs import Run, run
from .stages import STAGES

SEED = 1
AIMS = {"cold": "40 s", "warm": "12 s", "memory": "2048 MiB", "ratio": "30"}
COMPARABLE = 1.2  # the twin's rms error over etcfit's, at the same parameters


@dataclass(frozen=True)
class Timings:
    """All runs of the command, and of the same in stages, cold and warm."""

    cold: list[Run]
    warm: list[Run]
    cold_stages: list[dict[str, Any]]
    warm_stages: list[dict[str, Any]]

    @property
    def peak(self) -> float:
        return max(r.peak for r in (*self.cold, *self.warm))


def timings(folder: Path, scratch: Path, repeats: int) -> Timings:
    """Each repeat: cold and twice warm; then the same in stages, cold and warm, in a cache of its own."""
    out = Timings([], [], [], [])
    for k in range(repeats):
        for name, kept in (("cold", out.cold), ("warm", out.warm), ("warm", out.warm)):
            where = scratch / f"run {k} {name} {len(kept)}"
            kept.append(run(("-m", "etcfit.cli", "fit", folder, "--out", where, "--quiet"), scratch / f"cache {k}"))
            print(f"{name} {k + 1}: {kept[-1]}", flush=True)
        for name, stages in (("cold", out.cold_stages), ("warm", out.warm_stages)):
            where = scratch / f"stages {k} {name}"
            told = run(("-m", "benchmarks.stages", folder, where), scratch / f"cache of stages {k}")
            stages.append(json.loads(told.stdout.splitlines()[-1]))
            seconds = ", ".join(f"{stage} {stages[-1]['seconds'][stage]:.1f}" for stage in STAGES)
            print(f"{name} {k + 1} in stages: {told}   {seconds}", flush=True)
    return out


@dataclass(frozen=True)
class Twin:
    """SciPy on the same problem.

    Args:
        likeness: rms errors in sigma at etcfit's parameters, by trace: SciPy's, etcfit's.
        samples: fitted.
        parameters: free.
        evaluations: residuals computed, differences included.
        wall, cpu: s they took, one thread.
        jacobians: computed.
    """

    likeness: dict[str, tuple[float, float]]
    samples: int
    parameters: int
    evaluations: int
    wall: float
    cpu: float
    jacobians: int

    @property
    def a_jacobian(self) -> float:
        """CPU seconds for a Jacobian and the trial point that follows it."""
        return (self.parameters + 1) * self.cpu / self.evaluations

    @property
    def worst(self) -> float:
        return max(max(ours, theirs) / min(ours, theirs) for ours, theirs in self.likeness.values())


def twin(folder: Path, fitted_run: Path, trials: int) -> Twin:
    """Check that SciPy simulates what etcfit does, then time its least squares from etcfit's own start."""
    from etcfit.estimation.ready import start_values
    from etcfit.model.rig_effects import EdgePhase
    from etcfit.rig.paper_readings import read_graphs
    from etcfit.rig.reader import read_folder
    from etcfit.run_folder.state import load_fit

    rig, fitted = read_folder(folder), load_fit(fitted_run)
    known, values = fitted.free_parameters, {s: float(v) for s, v in fitted.values.items()}
    phases = {s.partition(".")[2]: v for s, v in values.items() if s.startswith(EdgePhase.kind)}
    traces = [plain(t, phase=phases.get(t.test.name, 0.0)) for t in fitted.problem.batch.traces]
    predicted = fitted.problem.free_run(fitted.x)
    body = scipy_twin.Rig(rig.config.gear_ratio, rig.config.travel)
    likeness = {
        t.name: (_rms((t.data - scipy_twin.simulate(t, values, body)) / t.sigma),
                             _rms((t.data - y) / t.sigma))
        for t, y in zip(traces, predicted, strict=True)
    }  # fmt: skip
    start = {s: max(v, 1e-3 * abs(values[s])) for s, v in start_values(known, read_graphs(rig)).items()}
    symbols = [s for s in known.layout.free if not s.startswith(EdgePhase.kind)]  # where edges come is given to it
    wall, cpu = time.time(), time.process_time()
    solved = scipy_twin.solve(traces, symbols, start, body, trials)
    wall, cpu = time.time() - wall, time.process_time() - cpu
    samples = sum(int(np.isfinite(t.data).any(axis=1).sum()) for t in traces)
    return Twin(likeness, samples, len(symbols), solved.evaluations, wall, cpu, solved.outcome.njev)


def _rms(array: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(array**2)))


def _median(runs: Iterable[Any], of: Callable[[Any], float]) -> float:
    return statistics.median(of(r) for r in runs)


def needed(fitted_run: Path, stages: dict[str, Any]) -> dict[str, int]:
    """How many Jacobians etcfit computed, by what for."""
    starts = [start["steps"] for start in json.loads((fitted_run / "fit.json").read_text())["starts"]]
    besides = {"beside its steps": stages["jacobians"].get("besides", 0)}
    rounds = stages["jacobians"]["steps"] - sum(starts)
    return {"from the reading": starts[0], "other starts": sum(starts[1:]), "rounds of whitening": rounds} | besides


def table(t: Timings, scipy: Twin, jacobians: dict[str, int]) -> str:
    """Medians against the aims; ratios both of CPU time and of wall time, which a busy machine spoils."""
    cold, warm = (
        {"wall": _median(runs, lambda r: r.wall), "cpu": _median(runs, lambda r: r.cpu)} for runs in (t.cold, t.warm)
    )
    rows = [
        ("`etcfit fit`, cold", f"{cold['wall']:.1f} s wall, {cold['cpu']:.1f} s cpu", AIMS["cold"]),
        ("`etcfit fit`, warm", f"{warm['wall']:.1f} s wall, {warm['cpu']:.1f} s cpu", AIMS["warm"]),
        ("peak memory", f"{t.peak:.0f} MiB", AIMS["memory"]),
    ]
    lean = {what: jacobians[what] for what in ("from the reading", "rounds of whitening")}
    for name, counted in (("as many Jacobians", jacobians), ("from the reading and rounds alone", lean)):
        cpu = scipy.a_jacobian * sum(counted.values())
        wall = cpu * scipy.wall / scipy.cpu
        ratios = f"{cpu / cold['cpu']:.0f} and {cpu / warm['cpu']:.0f} cpu, {wall / cold['wall']:.0f} and "
        rows += [
            (f"SciPy, {name} ({sum(counted.values())}), scaled", f"{wall:.0f} s wall, {cpu:.0f} s cpu", ""),
            ("its ratio to cold and to warm", f"{ratios}{wall / warm['wall']:.0f} wall", AIMS["ratio"]),
        ]
    lines = ["| | measured | aim |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows), ""]
    lines += ["| where the time goes, s wall | " + " | ".join(STAGES) + " |", "|---|" + "---|" * len(STAGES)]
    for name, stages in (("cold", t.cold_stages), ("warm", t.warm_stages)):
        each = [f"{_median(stages, lambda s, at=stage: s['seconds'][at]):.1f}" for stage in STAGES]
        lines.append(f"| {name} | " + " | ".join(each) + " |")
    return "\n".join(lines)


def words(scipy: Twin, jacobians: dict[str, int], stages: dict[str, Any]) -> str:
    """How SciPy's figure came about, and which programs were compiled."""
    counted = ", ".join(f"{n} {what}" for what, n in jacobians.items())
    alike = ", ".join(f"{file} {a:.3f}/{b:.3f}" for file, (a, b) in scipy.likeness.items())
    compiled = ", ".join(f"{name} {seconds:.1f}" for name, seconds in stages["programs"].items())
    return "\n".join([
        f"rms error in sigma at etcfit's parameters, SciPy/etcfit: {alike}; largest factor {scipy.worst:.3f} "
        f"(comparable: below {COMPARABLE})",
        f"SciPy: {scipy.samples} samples, {scipy.parameters} parameters, {scipy.evaluations} residuals "
        f"({scipy.jacobians} Jacobians by differences, the rest trial points) in {scipy.cpu:.1f} s cpu: "
        f"{scipy.cpu / scipy.evaluations:.2f} s a residual, {scipy.a_jacobian:.1f} s a Jacobian and its trial point. "
        f"SCALED to etcfit's Jacobians: {sum(jacobians.values())} ({counted}).",
        f"trace, lower and compile by program, cold, s: {compiled}",
    ])  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--trials", type=int, default=2, help="points SciPy may try; 1000 lets it go to its end")
    choices = parser.parse_args()
    from independent import CONSISTENT, draw_truth, make_folder

    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        folder = scratch / "folder"
        make_folder(folder, draw_truth(np.random.default_rng(SEED), CONSISTENT), SEED, size="bench")
        times = timings(folder, scratch, choices.repeats)
        fitted = scratch / "stages 0 cold"
        scipy = twin(folder, fitted, choices.trials)
        jacobians = needed(fitted, times.cold_stages[0])
    print(words(scipy, jacobians, times.cold_stages[0]))
    print()
    print(table(times, scipy, jacobians))
    return 0 if scipy.worst < COMPARABLE else 1


if __name__ == "__main__":
    sys.exit(main())
