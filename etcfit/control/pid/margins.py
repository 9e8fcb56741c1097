"""Stability margins of the linear loop, of many gains and plants at once.

    L(s) = (Kp + Ki/s + Kd s/(T_f s + 1)) G(s) exp(-s (T/2 + delay))

The ECU's hold counts as a delay of half a period (Astrom and Wittenmark 1997, ch. 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...model.ecu import Ecu
from ...model.linear import TransferFunction
from .gains import Gains

FINE = np.geomspace(0.05, 2e4, 4000)  # rad/s
COARSE = np.geomspace(2.0, 6e3, 120)  # rad/s; margins differ from those of FINE by some tenths of a dB and degree


def margins(gains: Gains, plants: Any, ecu: Ecu, grid: np.ndarray = FINE) -> tuple[np.ndarray, np.ndarray]:
    """Gain margin (dB) and phase margin (degrees).

    The phase margin is the smallest where the magnitude passes 1. The gain margin is the smallest change of the gain,
    up or down, that brings the loop to -180 degrees; below 0 where the phase margin is. Infinite where there is none.

    Args:
        gains: shape (...,) each.
        plants: a `TransferFunction` whose numbers broadcast with the gains.
        ecu: the controller.
        grid: frequencies between which the crossings are found, rad/s.
    """
    log, phase = _loop(gains, plants, ecu, grid)
    phase_margin = _at_crossing(log, phase + np.pi)
    gain = np.minimum(_at_crossing(phase + np.pi, np.abs(log)), _at_crossing(-phase - np.pi, np.abs(log)))
    return np.sign(phase_margin) * gain * 20.0 / np.log(10.0), np.degrees(phase_margin)


def _loop(gains: Gains, plants: TransferFunction, ecu: Ecu, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithm of the magnitude and unwrapped phase (rad), shape (..., W)."""
    s = 1j * grid
    p, i, d = (np.asarray(g, dtype=float)[..., None] for g in gains)
    b0, a2, a1, a0, delay, lag = (
        np.asarray(v, dtype=float)[..., None]
        for v in (plants.b0, plants.a2, plants.a1, plants.a0, plants.delay, plants.lag)
    )
    controller = p + i / s + d * s / (ecu.filter * s + 1.0)
    value = controller * b0 / (((s + a2) * s + a1) * s + a0) / (lag * s + 1.0)
    late = grid * (delay + ecu.late)
    return np.log(np.abs(value)), np.unwrap(np.angle(value), axis=-1) - late


def _at_crossing(fall: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The smallest value of `other` where `fall` passes 0 downwards, linear between frequencies; shape (...,)."""
    first, then = fall[..., :-1], fall[..., 1:]
    passes = (first > 0.0) & (then <= 0.0)
    share = first / np.where(passes, first - then, 1.0)
    value = other[..., :-1] + share * np.diff(other, axis=-1)
    return np.min(np.where(passes, value, np.inf), axis=-1)
