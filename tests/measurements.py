"""Measurements made by hand from the independent generator's motion, for the tests of what lies above the reader."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from etcfit.problem.trace import Trace, prepare
from etcfit.rig.base import Channel, Measurement, RigConfig
from independent import CONSISTENT, NONE
from independent import simulate as independent
from independent.drives import Drive, line
from independent.simulate import Motion

N = CONSISTENT.N
OPEN = float(np.pi / 2)
SIGMA = {"voltage": 0.01, "current": 0.008, "position": 1.1e-3, "emf": 0.01, "motor_speed": 1.0}
CONFIG = RigConfig("bench", gear_ratio=N, supply_V=12.0)


def channel(time: np.ndarray, value: np.ndarray, sigma: float) -> Channel:
    return Channel(time, value, sigma, False, "by hand", "", 1.0)


def measurement(test: str, time: np.ndarray, values: Mapping[str, np.ndarray], name: str = "a") -> Measurement:
    """Values as logged, with the noise of `SIGMA` declared but not added."""
    channels = {q: channel(time, v, SIGMA[q]) for q, v in values.items()}
    return Measurement(f"{test}/{name}.csv", test, time, channels)


def prepared(m: Measurement, config: RigConfig = CONFIG) -> Trace:
    """Made ready; there is something in it to predict."""
    trace = prepare(m, config)
    assert trace is not None
    return trace


def noisy(clean: Measurement, seed: int) -> Measurement:
    """The same with white noise as declared."""
    rng = np.random.default_rng(seed)
    channels = {
        q: channel(c.time, c.value + c.sigma * rng.standard_normal(c.value.size), c.sigma)
        for q, c in clean.channels.items()
    }
    return Measurement(clean.file, clean.test, clean.time, channels)


def released(at: float, duration: float = 0.4, rate: float = 1000.0) -> Motion:
    """A plate let go from open at an instant (s), terminals open."""
    time = np.arange(0.0, duration, 1.0 / rate)
    plant = independent.terminals_open(CONSISTENT, NONE)
    return independent.simulate(plant, line([0.0, duration], [0.0, 0.0]), time, angle=OPEN, held_until=at)


def driven(drive: Drive, angle: float, rate: float = 1000.0, held: bool = False) -> Motion:
    time = np.arange(drive.time[0], drive.time[-1], 1.0 / rate)
    plant = independent.throttle(CONSISTENT, NONE)
    return independent.simulate(plant, drive, time, angle=angle, held_until=independent.NEVER if held else 0.0)
