"""The problem that all peers get, and what one of them makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from independent import CONSISTENT, NONE, Bench, draw_truth, make_folder
from independent.drives import Drive
from independent.kernel import Plant
from independent.simulate import NEVER, simulate

from ..plain import PlainTrace, plain

PHASE = 0.5  # of a sample period: the rig's one clock drives output and logger, which every peer is told
IMPACT, AROUND = 50.0, 5e-3  # noises between one sample of the EMF and the next; s left out about such a fall
SHARE = 0.1  # of the motor's damping at the plate: the plate's where its reading is none
RELEASE = 2e-3  # s that a release instant may lie beside its reading
SERIES = "series_ohm.inductance"


@dataclass(frozen=True, eq=False)
class Problem:
    """Traces, parameters to find and where to start.

    Args:
        traces: to fit.
        start: of each free parameter, SI by symbol; those of Eqs. 1-2, `SERIES` and the release instants. K_m = K_b.
        N: gear ratio.
        travel: stops, rad.
    """

    traces: tuple[PlainTrace, ...]
    start: dict[str, float]
    N: float
    travel: tuple[float, float]

    @property
    def samples(self) -> int:
        """Numbers that are fitted."""
        return sum(int(np.isfinite(trace.data).sum()) for trace in self.traces)

    @property
    def freedom(self) -> int:
        """Those less the free parameters."""
        return self.samples - len(self.start)


@dataclass(frozen=True)
class Solved:
    """A peer's optimum.

    Args:
        values: SI by symbol, of every free parameter.
        chi2: sum of squares of (measured - simulated) / sigma by the peer's own model.
        words: how it ended, in a few words.
    """

    values: dict[str, float]
    chi2: float
    words: str


def make(folder: Path, seed: int, size: str) -> dict[str, float]:
    """Write a measurement folder; its truth, SI by symbol."""
    truth, bench = draw_truth(np.random.default_rng(seed), CONSISTENT), Bench(edge_phase=PHASE)
    make_folder(folder, truth, seed, size=size, bench=bench)  # type: ignore[arg-type]
    return {**vars(truth), SERIES: bench.series_ohm}


def problem_of(folder: Path) -> Problem:
    """What etcfit knows of a folder before any fit."""
    from etcfit.estimation.ready import ready, start_values
    from etcfit.problem.free_parameters import free_parameters
    from etcfit.rig.paper_readings import read_graphs
    from etcfit.rig.reader import read_folder

    rig = read_folder(folder)
    known = free_parameters(rig.config)
    traces = tuple(_without_impacts(plain(trace, 1.0 - PHASE)) for trace in ready(rig).fitted)
    read = start_values(known, read_graphs(rig))
    start = {symbol: float(read[symbol]) for symbol in known.layout.free}
    if not start["B_L"] > 0.0:  # a difference of two readings
        start["B_L"] = SHARE * rig.config.gear_ratio**2 * start["B_m"]
    start |= {trace.release_symbol: trace.release for trace in traces if trace.release is not None}
    return Problem(traces, start, rig.config.gear_ratio, rig.config.travel)


def _without_impacts(trace: PlainTrace) -> PlainTrace:
    """The trace without the samples of the EMF about the instant at which the plate hits its stop.

    There the EMF falls by hundreds of noises from one sample to the next. A model that lands a sample early or late
    sees a wall in place of a slope, and its descent ends there.
    """
    if "emf" not in trace.channels:
        return trace
    m, data, times = trace.channels.index("emf"), trace.data.copy(), trace.instants
    for hit in times[1:][np.abs(np.diff(data[:, m])) > IMPACT * trace.sigma[m]]:
        data[np.abs(times - hit) < AROUND, m] = np.nan
    return replace(trace, data=data)


def chi2(traces: Sequence[PlainTrace], paths: Sequence[np.ndarray]) -> float:
    """Sum of squares of (measured - simulated) / sigma over everything that was logged."""
    return sum(float(np.nansum(((t.data - y) / t.sigma) ** 2)) for t, y in zip(traces, paths, strict=True))


def accurate_chi2(problem: Problem, values: Mapping[str, float]) -> float:
    """That of the independent simulation, whose friction and stops are exact; release instants are fitted to it.

    Args:
        values: SI by symbol; release instants are not looked at.
    """
    return sum(_best_release(problem, trace, values) for trace in problem.traces)


def _best_release(problem: Problem, trace: PlainTrace, values: Mapping[str, float]) -> float:
    def misfit(release: float) -> float:
        return chi2([trace], [accurate(problem, trace, {**values, trace.release_symbol: release})])

    if trace.release is None:
        return misfit(0.0)
    near = (trace.release - RELEASE, trace.release + RELEASE)
    found: Any = minimize_scalar(misfit, bounds=near, method="bounded", options={"xatol": 1e-7})
    return float(found.fun)


def accurate(problem: Problem, trace: PlainTrace, v: Mapping[str, float]) -> np.ndarray:
    """What a trace's channels would show by that simulation, SI, shape (n, M)."""
    N, plate = problem.N, 0.0 if trace.gear_apart else 1.0
    lower, upper = (-NEVER, NEVER) if trace.gear_apart else problem.travel
    R = v["R_a"] + v.get(f"series_ohm.{trace.test}", 0.0)
    plant = Plant(
        R=R, L=v["L_a"], closed_circuit=float(trace.circuit), k=N * v["K_b"], k_t=N * v["K_b"],
        J=N**2 * v["J_m"] + plate * v["J_L"], B=N**2 * v["B_m"] + plate * v["B_L"], K_s=plate * v["K_s"],
        T_PL=plate * v["T_PL"], T_f=plate * v["T_f"], N=N, lower=lower, upper=upper, effects=NONE,
    )  # fmt: skip
    lead = 30.0 * plant.L / R if trace.plate_held else 0.0  # until the current is what the first volts make of it
    first, last = trace.instants[[0, -1]]
    drive = Drive(np.concatenate(([first - lead], trace.knots, [last])), np.pad(trace.volts, 1, mode="edge"))
    release = trace.release_at(v)
    until = NEVER if trace.plate_held else first if release is None else release
    motion = simulate(plant, drive, trace.instants, angle=trace.start[1], held_until=until)
    seen = {"current": motion.current, "position": motion.angle, "emf": plant.k * motion.speed,
            "motor_speed": N * motion.speed}  # fmt: skip
    return np.stack([seen[name] for name in trace.channels], axis=1)
