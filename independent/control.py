"""A throttle body under an engine computer: setpoint in, what the plate really does out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .kernel import Plant, at_rest, mode_at_rest, record, run_loop
from .simulate import H_MAX, longest_step


@dataclass(frozen=True)
class Computer:
    """An engine computer that samples, computes and holds."""

    # proportional, integral, derivative: V/rad, V/(rad s), V s/rad
    proportional: float
    integral: float
    derivative: float
    period: float = 1e-3  # s
    supply: float = 12.0  # V
    filter: float = 2e-3  # time constant of the derivative, s
    delay: float = 0.0  # s
    grain: float = 0.0  # of the position it reads, rad
    noise: float = 0.0  # of the position it reads, rad, a standard deviation
    hold: float = 0.0  # largest integral, V, which then runs on at the output's limit; 0: it stands still there


def follow(plant: Plant, computer: Computer, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (rad) and voltage (V) at each sample, from rest at the first angle asked for (rad, one a period)."""
    out, _ = _run(plant, computer, np.asarray(wanted, dtype=float), np.zeros(len(wanted)))
    return out[:, 0], out[:, 1]


def helped(plant: Plant, computer: Computer, wanted: np.ndarray, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `follow`, of a computer that adds a voltage (V, one a period) to what its PID makes."""
    out, _ = _run(plant, computer, np.asarray(wanted, dtype=float), np.zeros(len(wanted)), ahead=ahead)
    return out[:, 0], out[:, 1]


def noisy(plant: Plant, computer: Computer, wanted: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Angle (rad) and voltage (V) at each sample, shape (n, 2), of a computer that misreads every sample."""
    misread = computer.noise * rng.standard_normal(len(wanted))
    return _run(plant, computer, np.asarray(wanted, dtype=float), misread)[0]


def watched(
    plant: Plant, computer: Computer, wanted: np.ndarray, instants: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Angle that the sensor shows at any instants within the run (s), from the same start, rad."""
    misread = computer.noise * rng.standard_normal(len(wanted))
    _, path = _run(plant, computer, np.asarray(wanted, dtype=float), misread)
    return np.interp(instants, np.arange(len(path)) * len(wanted) * computer.period / len(path), path)


def failing(plant: Plant, computer: Computer, wanted: np.ndarray, misread: np.ndarray, shown: np.ndarray,
            feed: np.ndarray) -> np.ndarray:  # fmt: skip
    """Angle at each sample, rad, where sensor and supply may fail: see `kernel.run_loop` for the arrays, shape (n,)."""
    return _run(plant, computer, np.asarray(wanted, dtype=float), misread, shown, feed)[0][:, 0]


def _run(
    plant: Plant,
    computer: Computer,
    wanted: np.ndarray,
    misread: np.ndarray,
    shown: np.ndarray | None = None,
    feed: np.ndarray | None = None,
    ahead: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    shown = np.full(len(wanted), np.nan) if shown is None else shown
    feed = np.ones(len(wanted)) if feed is None else feed
    ahead = np.zeros(len(wanted)) if ahead is None else np.asarray(ahead, dtype=float)
    parts = max(1, math.ceil(computer.period / longest_step(plant, H_MAX)))
    p, x = record(plant), at_rest(plant, float(wanted[0]))
    gains = np.array([computer.proportional, computer.integral, computer.derivative])
    late = round((computer.delay + plant.effects.actuation_delay.delay) * parts / computer.period)
    return run_loop(p, wanted, ahead, misread, shown, feed, computer.period, parts, gains, computer.filter,
                    computer.supply, computer.hold, late, computer.grain, mode_at_rest(p, x), x)  # fmt: skip


def trapezoids(low: float, high: float, period: float, edge: float = 0.1, lead: float = 0.5) -> np.ndarray:
    """low for `lead` s, then up for half a second and down for another, with edges of `edge` s; one value a period."""
    corners = [0.0, lead, lead + edge, lead + 0.5, lead + 0.5 + edge, lead + 1.0]
    return np.interp(np.arange(round((lead + 1.0) / period)) * period, corners, [low, low, high, high, low, low])


@dataclass(frozen=True)
class Score:
    """Worst of both edges: overshoot %, settling s, steady-state error %, each of the change; RMSE, % of the travel."""

    overshoot: float
    settling: float
    error: float
    rmse: float

    @property
    def meets_the_papers_requirements(self) -> bool:
        """Overshoot below 20 %, settling below 0.2 s, steady-state error below 0.5 %."""
        return self.overshoot < 20.0 and self.settling < 0.2 and self.error < 0.5


def score(angle: np.ndarray, wanted: np.ndarray, period: float, travel: float, lead: float = 0.5) -> Score:
    """Judge a response to `trapezoids`."""
    first, half = round(lead / period), round(0.5 / period)
    low, high = float(wanted[0]), float(wanted[first + half - 1])
    found = []
    for begin, level, change in ((first, high, high - low), (first + half, low, low - high)):
        part = (angle[begin : begin + half] - level) / change
        late = [k for k in range(half) if abs(part[k]) > 0.02]
        settling = float("inf") if late and late[-1] == half - 1 else (late[-1] + 1) * period if late else 0.0
        found.append((100.0 * max(part.max(), 0.0), settling, 100.0 * np.abs(part[-half // 4 :]).max()))
    rmse = 100.0 * float(np.sqrt(np.mean((angle[first:] - wanted[first:]) ** 2))) / travel
    overshoot, settled, error = (float(max(column)) for column in zip(*found, strict=True))
    return Score(overshoot, settled, error, rmse)
