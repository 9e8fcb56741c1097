"""A second-order loop that follows steps: the closed form of its answer. It shares no code with etcfit."""

from __future__ import annotations

import math

import numpy as np


def answer(t: np.ndarray, zeta: float, wn: float) -> np.ndarray:
    """Unit step of wn^2/(s^2 + 2 zeta wn s + wn^2), zeta not 1; 0 before 0."""
    s = np.maximum(t, 0.0)
    if zeta < 1.0:
        wd = wn * math.sqrt(1.0 - zeta**2)
        return 1.0 - np.exp(-zeta * wn * s) * (np.cos(wd * s) + zeta * wn / wd * np.sin(wd * s))
    a, b = (wn * (zeta + sign * math.sqrt(zeta**2 - 1.0)) for sign in (1.0, -1.0))
    return 1.0 - (a * np.exp(-b * s) - b * np.exp(-a * s)) / (a - b)


def overshoot(zeta: float) -> float:
    """Of a step, per cent."""
    return 100.0 * math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)) if zeta < 1.0 else 0.0


def settled(zeta: float, wn: float, band: float) -> float:
    """The last instant (s) at which it is further off than `band`, a share of the step."""
    t = np.arange(0.0, 3.0, 1e-5)
    return float(t[np.flatnonzero(np.abs(answer(t, zeta, wn) - 1.0) > band)[-1]])


def log(
    levels: list[float], zeta: float, wn: float, rate: float, noise: float = 0.0, seed: int = 0, held: float = 1.0
) -> dict[str, np.ndarray]:
    """Time (s), position and setpoint (%) of levels held for `held` s, the jumps between two samples."""
    time = np.arange(0.0, held * len(levels), 1.0 / rate)
    jumps = held * np.arange(1, len(levels)) - 0.5 / rate
    position = levels[0] + sum(
        (b - a) * answer(time - jump, zeta, wn) for a, b, jump in zip(levels, levels[1:], jumps, strict=False)
    )
    shown = position + noise * np.random.default_rng(seed).standard_normal(time.size)
    return {"time": time, "position": shown, "setpoint": np.array(levels)[np.searchsorted(jumps, time)]}
