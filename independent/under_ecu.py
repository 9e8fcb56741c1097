"""Logs of a plate under its engine computer: setpoint and position alone, or its duty, sampled too slowly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from .control import Computer, noisy, watched
from .effects import NONE, Effects
from .folder import write_trace
from .instruments import CLOSED_V, OPEN_V, UNITS, Bench, clock, wiper
from .protocols import Trace
from .simulate import throttle
from .truth import OPEN, Truth

UNITS.setdefault("deg", (1.0, 4))
STEP_DEG = 0.01  # of the logged setpoint


@dataclass(frozen=True)
class Log:
    """How one trace is logged."""

    duration: float = 3.0  # s
    rate: float = 500.0  # Hz
    lead: float = 0.7  # s that the computer ran before the log began
    # low, high: between which it asks, shares of the travel
    low: float = 0.12
    high: float = 0.85


def setpoint(rng: np.random.Generator, kind: str, time: np.ndarray, low: float, high: float) -> np.ndarray:
    """Angle asked for between low and high, rad: trapezoids of random levels and edges, steps of random levels, slow
    ramps, a sum of sines, or strokes of a pedal."""
    if kind == "steps":
        jumps = np.cumsum(rng.uniform(0.15, 0.45, 1 + int(time[-1] / 0.15)))
        return rng.uniform(low, high, len(jumps) + 1)[np.searchsorted(jumps, time, side="right")]
    if kind == "ramps":
        corners = np.cumsum(np.append(0.0, rng.uniform(0.4, 0.9, 1 + int(time[-1] / 0.4))))
        return np.interp(time, corners, rng.uniform(low, high, len(corners)))
    if kind == "trapezoids":
        corners, levels = [0.0], [rng.uniform(low, high)]
        while corners[-1] < time[-1]:
            corners += [corners[-1] + rng.uniform(0.15, 0.5), 0.0]
            corners[-1] = corners[-2] + rng.uniform(0.05, 0.2)
            levels += [levels[-1], rng.uniform(low, high)]
        return np.interp(time, corners, levels)
    if kind == "sines":
        hertz, phase = np.array([0.4, 1.1, 2.7, 5.3]), rng.uniform(0, 2 * np.pi, 4)
        share = np.array([0.5, 0.3, 0.15, 0.1]) @ np.sin(2 * np.pi * hertz[:, None] * time + phase[:, None])
        return 0.5 * (low + high) + 0.45 * (high - low) * share
    if kind == "pedal":
        knots = np.arange(0.0, time[-1] + 0.6, 0.3)
        smooth = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 30))
        levels = rng.uniform(low, high, len(knots))
        fine = np.concatenate([a + (b - a) * smooth for a, b in pairwise(levels)])
        return np.interp(time, np.linspace(0.0, knots[-1], len(fine)), fine)
    raise ValueError(kind)


def log(
    rng: np.random.Generator, truth: Truth, computer: Computer, kind: str, how: Log, effects: Effects, bench: Bench
) -> dict[str, np.ndarray]:
    """Columns of one trace: setpoint and sensor volts at ticks of the computer, stamped by a clock that jitters."""
    ticks = np.arange(0.0, how.lead + how.duration + 2.0 * computer.period, computer.period)
    wanted = setpoint(rng, kind, ticks, how.low * OPEN, how.high * OPEN)
    instants = clock(rng, bench, how.rate, how.duration)
    true = how.lead + np.round((instants.true - instants.true[0]) / computer.period) * computer.period
    angle = watched(throttle(truth, effects), computer, wanted, true, rng)
    volts = CLOSED_V + (OPEN_V - CLOSED_V) * wiper(effects, angle) / OPEN
    latest = wanted[np.floor(true / computer.period + 1e-9).astype(int)]
    return {
        "time [s]": bench.time_step * np.round(instants.true / bench.time_step),
        "setpoint [deg]": STEP_DEG * np.round(np.degrees(latest) / STEP_DEG),
        "tps [V]": bench.sensors["tps"].read(rng, volts),
    }


def add_logs(
    path: Path,
    truth: Truth,
    computer: Computer,
    seed: int,
    kinds: tuple[str, ...] = ("trapezoids", "sines", "pedal"),
    how: Log | None = None,
    effects: Effects = NONE,
    test: str = "closed_loop",
) -> list[str]:
    """Write one CSV for each kind into a measurement folder; their names."""
    rng, bench = np.random.default_rng([seed, 5]), Bench()
    (path / test).mkdir(parents=True, exist_ok=True)
    files = []
    for n, kind in enumerate(kinds, 1):
        trace = Trace(f"{test}/{kind}_{n}.csv", log(rng, truth, computer, kind, how or Log(), effects, bench))
        write_trace(path, trace, seed)
        files.append(trace.file)
    return files


def add_coarse_logs(
    path: Path,
    truth: Truth,
    computer: Computer,
    seed: int,
    kinds: tuple[str, ...] = ("steps", "trapezoids", "pedal", "steps"),
    how: Log | None = None,
    test: str = "response",
) -> list[str]:
    """Write one CSV for each kind, duty and position, sampled more slowly than the computer's output changes.

    Each row has the output that the computer holds at that instant; what it did between two rows nobody logged.
    """
    rng, bench, how = np.random.default_rng([seed, 6]), Bench(), how or Log(rate=100.0)
    (path / test).mkdir(parents=True, exist_ok=True)
    files = []
    for n, kind in enumerate(kinds, 1):
        ticks = np.arange(0.0, how.lead + how.duration + 2.0 * computer.period, computer.period)
        wanted = setpoint(rng, kind, ticks, how.low * OPEN, how.high * OPEN)
        angle, volts = noisy(throttle(truth, NONE), computer, wanted, rng).T
        time = np.arange(round(how.duration * how.rate)) / how.rate
        at = np.floor((how.lead + time) / computer.period + 1e-9).astype(int)
        read = bench.sensors["tps"].read(rng, CLOSED_V + (OPEN_V - CLOSED_V) * angle[at] / OPEN)
        columns = {"time [s]": time, "duty [%]": 100.0 * volts[at] / computer.supply, "tps [V]": read}
        trace = Trace(f"{test}/{kind}_{n}.csv", columns)
        write_trace(path, trace, seed)
        files.append(trace.file)
    return files
