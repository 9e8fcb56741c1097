"""Skogestad's SIMC."""

from __future__ import annotations

import numpy as np

from .base import Refusal, Task
from .gains import Gains


def simc(task: Task) -> Gains | Refusal:
    """Kc = T1 / (k (Tc + L)), Ti = min(T1, 4 (Tc + L)), Td = T2 in series form, with Tc = L ("tight").

    The plant becomes k exp(-L s) / ((T1 s + 1) (T2 s + 1)) by the half rule: of its time constants T1 > t2 > t3 and the
    sensor's lag, T2 = t2 + t3 / 2 and L = delay + t3 / 2 + the rest.

    Source: Skogestad 2003, J. Process Control 13(4). Differs from source: the time constant of a complex pole is
    1 / |pole|; half the ECU's period and all by which its derivative lags count as delay, for Tc = L leaves neither.
    """
    plant = task.plant
    times = sorted((*(1.0 / np.abs(plant.poles)), plant.lag), reverse=True)
    if not np.isfinite(plant.dc_gain) or not np.all(plant.poles.real < 0.0):
        return Refusal("the plant has no spring: SIMC's rule for a lag does not apply")
    T1, t2, t3, *rest = times
    T2 = t2 + 0.5 * t3
    L = plant.delay + task.ecu.late + task.ecu.derivative_late + 0.5 * t3 + sum(rest)
    return Gains.series(T1 / (plant.dc_gain * 2.0 * L), min(T1, 8.0 * L), T2)
