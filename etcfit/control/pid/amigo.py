"""Astrom and Hagglund's AMIGO."""

from __future__ import annotations

import numpy as np

from ...model.linear import TransferFunction
from .base import Refusal, Task
from .gains import Gains


def amigo(task: Task) -> Gains | Refusal:
    """Kp = (0.2 + 0.45 T/L) / K, Ti = L (0.4 L + 0.8 T) / (L + 0.1 T), Td = 0.5 L T / (0.3 L + T).

    The plant becomes K exp(-L s) / (T s + 1): L where the steepest tangent of its step response cuts zero, L + T where
    the response reaches 63 % of its end.

    Source: Astrom and Hagglund 2004, J. Process Control 14(6). Differs from source: setpoint weight 1, and half the
    ECU's period counts as delay.
    """
    plant = task.plant
    if not np.isfinite(plant.dc_gain) or not np.all(plant.poles.real < 0.0):
        return Refusal("the plant has no spring: its step response has no end")
    T, L = first_order(plant)
    L += plant.delay + plant.lag + task.ecu.late
    kp = (0.2 + 0.45 * T / L) / plant.dc_gain
    return Gains.standard(kp, L * (0.4 * L + 0.8 * T) / (L + 0.1 * T), 0.5 * L * T / (0.3 * L + T))


def first_order(plant: TransferFunction) -> tuple[float, float]:
    """Time constant T and apparent delay L of the plant's step response, s."""
    slowest = 1.0 / float(np.min(-plant.poles.real))
    fastest = 1.0 / float(np.max(np.abs(plant.poles)))
    time = np.concatenate((np.linspace(0.0, 60.0 * fastest, 3000, endpoint=False),
                           np.geomspace(60.0 * fastest, max(12.0 * slowest, 70.0 * fastest), 6000)))  # fmt: skip
    y = _step(plant, time)
    slope = np.gradient(y, time)
    k = int(np.argmax(slope))
    L = max(time[k] - y[k] / slope[k], 0.0)
    reached = int(np.argmax(y >= (1.0 - np.exp(-1.0)) * plant.dc_gain))
    return float(time[reached] - L), float(L)


def _step(plant: TransferFunction, time: np.ndarray) -> np.ndarray:
    """Step response by partial fractions, at any instants (s)."""
    from scipy.signal import residue

    r, p, _ = residue(plant.num, (*plant.den, 0.0))
    return np.real(np.exp(np.outer(time, p)) @ r)
