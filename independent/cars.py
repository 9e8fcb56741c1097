"""Cars of which nobody has more than the ECU's own log: a throttle body, an ECU with poor gains, and what it logs.

Each row has what the ECU knew at its last tick: position, target, duty and battery, rounded as it writes them. What its
output did between two rows nobody logged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .control import Computer, noisy, score, trapezoids
from .effects import Effects, LimpHomeSpring, StribeckFriction
from .kernel import Plant
from .simulate import throttle
from .truth import OPEN, Truth, draw_truth
from .under_ecu import setpoint

PERIOD, DUTY, INTEGRAL = 2e-3, 0.9, 0.3  # s and shares of the supply: an ECU of 500 Hz
RATES = (100.0, 200.0, 500.0, 1000.0)  # Hz
NOISE, GRAIN = 0.0004, 1.0 / 4096.0  # of the ECU's own reading, shares of the travel
POOR = (2.2, 8.0)  # RMSE of a trapezoid, % of the travel, between which present gains are poor and still drive
RESTS = (0.05, 0.12, 0.3, 0.6)  # shares of the travel at which the bench test of an ECU holds


@dataclass(frozen=True)
class Car:
    """One car."""

    # truth, effects: its throttle body
    truth: Truth
    effects: Effects
    supply: float  # V
    gains: tuple[float, float, float]  # in the ECU, P (%/%), I (%/%, per s), D (%/%, times s)
    rate: float  # of the log, Hz
    duration: float  # of the log, s
    # each row is written at a tick of the ECU; else rows come at any instant, with what the last tick knew
    in_step: bool

    @property
    def plant(self) -> Plant:
        """As it moves."""
        return throttle(self.truth, self.effects)

    def computer(self, gains: tuple[float, float, float] | None = None) -> Computer:
        """The ECU with its present gains, or with others."""
        unit = self.supply / OPEN  # V/rad in one % of duty for one % of the travel
        p, i, d = (unit * gain for gain in (self.gains if gains is None else gains))
        return Computer(p, i, d, PERIOD, DUTY * self.supply, filter=0.0, delay=PERIOD, grain=GRAIN * OPEN,
                        noise=NOISE * OPEN, hold=INTEGRAL * self.supply)  # fmt: skip


def draw_car(seed: int) -> Car:
    """The paper's throttle +-40 %, a limp-home spring, more friction at rest; gains drawn until they are poor."""
    rng = np.random.default_rng([seed, 39])
    truth = draw_truth(rng)
    limp = LimpHomeSpring(math.radians(rng.uniform(6.0, 13.0)), rng.uniform(0.5, 1.5), rng.uniform(0.25, 0.45),
                          rng.uniform(0.005, 0.012))  # fmt: skip
    stribeck = StribeckFriction(truth.T_f * rng.uniform(0.05, 0.4), rng.uniform(0.2, 0.8))
    effects = Effects(limp_home_spring=limp, stribeck_friction=stribeck)
    car = Car(truth, effects, round(float(rng.uniform(12.0, 14.4)), 2), (1.0, 1.0, 0.01),
              RATES[seed % len(RATES)], float(rng.uniform(25.0, 40.0)), bool(rng.uniform() < 0.5))  # fmt: skip
    wanted = trapezoids(0.10 * OPEN, 0.45 * OPEN, PERIOD)
    while True:
        gains = tuple(float(math.exp(rng.uniform(math.log(low), math.log(high))))
                      for low, high in ((1.0, 12.0), (2.0, 80.0), (0.01, 0.3)))  # fmt: skip
        car = replace(car, gains=(gains[0], gains[1], gains[2]))
        path = noisy(car.plant, car.computer(), wanted, rng)
        if POOR[0] < score(path[:, 0], wanted, PERIOD, OPEN).rmse < POOR[1]:
            return car


def driven(rng: np.random.Generator, ticks: np.ndarray) -> np.ndarray:
    """Angle asked for, rad: rests, the steps of a bench test, strokes of a pedal, in turn."""
    whole = np.zeros_like(ticks)
    begin, turn = 0.0, 0
    kinds = ("rest", "pedal", "steps", "pedal", "ramps")
    while begin < ticks[-1]:
        kind = kinds[turn % len(kinds)]
        length = {"rest": 1.5, "steps": 3.0}.get(kind, float(rng.uniform(3.0, 6.0)))
        here = (ticks >= begin) & (ticks < begin + length)
        own = ticks[here] - begin
        if own.size > 1:
            if kind == "rest":
                whole[here] = RESTS[int(rng.integers(len(RESTS)))] * OPEN
            else:
                whole[here] = setpoint(rng, kind, own, 0.03 * OPEN, float(rng.uniform(0.4, 0.9)) * OPEN)
        begin, turn = begin + length, turn + 1
    return np.clip(whole, 0.0, OPEN)


def log_of(car: Car, seed: int) -> dict[str, np.ndarray]:
    """Columns of the ECU's own log."""
    rng = np.random.default_rng([seed, 40])
    ticks = np.arange(0.0, car.duration + 1.0, PERIOD)
    wanted = driven(rng, ticks)
    angle, volts = noisy(car.plant, car.computer(), wanted, rng).T
    rate = min(car.rate, 1.0 / PERIOD) if car.in_step else car.rate
    rows = np.arange(round(car.duration * rate)) / rate
    if car.in_step:
        rows = PERIOD * np.round(rows / PERIOD) + 0.1 * PERIOD
    instants = 0.5 + rows + np.clip(0.05 * PERIOD * rng.standard_normal(rows.size), 0.0, 0.5 * PERIOD)
    at = np.floor(instants / PERIOD + 1e-9).astype(int)
    seen = angle[at] / OPEN + NOISE * rng.standard_normal(at.size)
    return {
        "Time (s)": np.round(instants - 0.5, 4),
        "TPS (%)": np.round(100.0 * seen, 2),
        "ETB Target (%)": np.round(100.0 * wanted[at] / OPEN, 2),
        "ETB Duty (%)": np.round(100.0 * volts[at] / car.supply, 2),
        "Battery (V)": np.round(car.supply + 0.03 * rng.standard_normal(at.size), 2),
    }


def write_log(path: Path, columns: dict[str, np.ndarray]) -> None:
    """A CSV as an ECU's program exports it."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{value:.10g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def tracking_errors(
    car: Car, gains: tuple[float, float, float], seed: int, duration: float = 20.0
) -> tuple[float, float]:
    """Mean absolute error and RMSE of the true plant under gains, on a fresh driven setpoint, % of the travel."""
    rng = np.random.default_rng([seed, 41])
    wanted = driven(rng, np.arange(0.0, duration, PERIOD))
    angle = noisy(car.plant, car.computer(gains), wanted, rng)[:, 0]
    error = 100.0 * (angle - wanted) / OPEN
    return float(np.mean(np.abs(error))), float(np.sqrt(np.mean(error**2)))
