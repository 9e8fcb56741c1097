"""A plate with stiction under a PID in per cent of duty: it follows, hunts by stick-slip, or is unstable.

    a = g (u - k (y - y_0) - c v - friction),    friction: F while it slides, up to F_s while it sticks

y in per cent of travel, u in per cent of duty, each torque as the duty that holds it. It shares no code with etcfit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

TICK = 1e-3  # s, of the controller
PARTS = 4  # steps of the plant in a tick


@dataclass(frozen=True)
class Plate:
    """What is driven."""

    g: float = 900.0  # acceleration a per cent of duty makes, %/s^2
    # k, y0: spring, % of duty a % of travel, and where it is slack, %
    k: float = 0.15
    y0: float = 8.0
    c: float = 0.04  # drag, % of duty a %/s
    # sliding, sticking: dry friction, % of duty
    sliding: float = 4.0
    sticking: float = 4.0
    delay: int = 2  # ticks between a reading and its duty


@dataclass(frozen=True)
class Pid:
    """What drives it."""

    # p, i, d: % of duty a % of error, a % s, a %/s
    p: float = 5.0
    i: float = 20.0
    d: float = 0.1
    most: float = 90.0  # limit of the duty, %
    dead_zone: float = 0.0  # |error| below which the integral stands still, %
    dither: float = 0.0  # amplitude of a square wave added to the duty, %, and its half period, ticks
    half_period: int = 5


def ultimate(plate: Plate) -> float:
    """P at which the loop without friction oscillates under P alone, by bisection on its phase."""
    late = (plate.delay + 0.5) * TICK

    def phase(w: float) -> float:
        return -math.atan2(plate.g * plate.c * w, plate.g * plate.k - w * w) - w * late

    low, high = 1.0, 5e3
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if phase(middle) > -math.pi else (low, middle)
    return math.hypot(plate.g * plate.k - low * low, plate.g * plate.c * low) / plate.g


def run(
    plate: Plate, pid: Pid, wanted: np.ndarray, noise: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """True position and duty at each tick, %, from rest at the first setpoint (%, one a tick); the ECU misreads by
    `noise` (%, a standard deviation)."""
    y, v = float(wanted[0]), 0.0
    integral = plate.k * (y - plate.y0)
    sent = [integral] * (plate.delay + 1)
    before, dt = y, TICK / PARTS
    misread = noise * rng.standard_normal(len(wanted))
    out = np.empty((len(wanted), 2))
    slope = 0.0
    for n, aim in enumerate(wanted.tolist()):
        seen = y + misread[n]
        slope += 0.2 * ((seen - before) / TICK - slope)
        before, error = seen, aim - seen
        raw = pid.p * error + integral - pid.d * slope
        duty = min(max(raw, -pid.most), pid.most)
        if duty == raw and abs(error) > pid.dead_zone:
            integral += pid.i * error * TICK
        out[n] = y, duty
        sign = 1.0 if (n // pid.half_period) % 2 else -1.0
        sent = [min(max(duty + sign * pid.dither, -pid.most), pid.most), *sent[:-1]]
        for _ in range(PARTS):
            y, v = _step(plate, y, v, sent[-1], dt)
    return out[:, 0], out[:, 1]


def _step(plate: Plate, y: float, v: float, duty: float, dt: float) -> tuple[float, float]:
    force = duty - plate.k * (y - plate.y0)
    if v == 0.0:
        if abs(force) <= plate.sticking:
            return y, 0.0
        v = math.copysign(1e-9, force)
    sign = math.copysign(1.0, v)
    # the drag implicitly: no step is too long for it
    after = (v + dt * plate.g * (force - sign * plate.sliding)) / (1.0 + dt * plate.g * plate.c)
    if after * sign <= 0.0:
        after = 0.0
    y += dt * after
    return (min(max(y, 0.0), 100.0), 0.0 if y <= 0.0 or y >= 100.0 else after)


def staircase(
    rng: np.random.Generator, seconds: float, held: float, low: float = 15.0, high: float = 85.0
) -> np.ndarray:
    """Setpoint of random levels, each held for `held` s, %, one a tick."""
    count = round(seconds / held)
    return np.repeat(rng.uniform(low, high, count), round(held / TICK))


def logged(
    rng: np.random.Generator,
    wanted: np.ndarray,
    true: np.ndarray,
    duty: np.ndarray,
    rate: float,
    noise: float,
    grain: float,
) -> dict[str, np.ndarray]:
    """Columns of a log at a rate (Hz): time s, setpoint, position and duty in %, the position noisy and rounded."""
    every = np.arange(0, len(wanted), round(1.0 / (rate * TICK)))
    seen = true[every] + noise * rng.standard_normal(every.size)
    shown = grain * np.round(seen / grain) if grain else seen
    return {
        "time": every * TICK,
        "setpoint": np.round(wanted[every], 1),
        "position": shown,
        "duty": np.round(duty[every], 2),
    }


KINDS = ("calm", "stick-slip", "instability")


def drawn(kind: str, rng: np.random.Generator) -> tuple[Plate, Pid]:
    """A plate and gains of which this kind comes."""
    plate = Plate(g=rng.uniform(600.0, 1400.0), k=rng.uniform(0.08, 0.25), c=rng.uniform(0.025, 0.06),
                  sliding=rng.uniform(2.0, 6.0), delay=int(rng.integers(1, 5)))  # fmt: skip
    if kind == "stick-slip":
        plate = replace(plate, sticking=plate.sliding * rng.uniform(1.4, 2.2))
        p = ultimate(plate) * rng.uniform(0.1, 0.25)
        return plate, Pid(p, p * rng.uniform(8.0, 20.0), p * rng.uniform(0.015, 0.03))
    plate = replace(plate, sticking=plate.sliding)
    if kind == "calm":
        p = ultimate(plate) * rng.uniform(0.15, 0.3)
        return plate, Pid(p, p * rng.uniform(1.0, 4.0), p * rng.uniform(0.015, 0.03))
    plate = replace(plate, sliding=0.3 * plate.sliding, sticking=0.3 * plate.sliding)
    return plate, Pid(ultimate(plate) * rng.uniform(1.15, 1.8), rng.uniform(0.0, 20.0), 0.0)


def truth(path: np.ndarray) -> tuple[float, float]:
    """Amplitude (half of peak to peak, %) and period (s, from upward crossings of the mean) of a path at each tick."""
    middle = 0.5 * (path.max() + path.min())
    up = np.flatnonzero((path[:-1] < middle) & (path[1:] >= middle))
    period = float(np.mean(np.diff(up)) * TICK) if up.size > 1 else math.inf
    return 0.5 * float(np.ptp(path)), period
