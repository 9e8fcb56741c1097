"""The paper's manual procedure, automated."""

from __future__ import annotations

import numpy as np

from .base import Refusal, Task
from .gains import Gains
from .response import Judged
from .setpoint import trapezoid

_P = np.geomspace(0.2, 120.0, 48)  # V/rad
_D = np.concatenate(([0.0], np.geomspace(1e-3, 3.0, 47)))  # V s/rad
_I = np.concatenate(([0.0], np.geomspace(0.1, 5000.0, 47)))  # V/(rad s)
_QUICK = 1.05  # RMSE over the least that proportional gain alone reaches


def manual(task: Task) -> Gains | Refusal:
    """P until quick, D until calm, then a little I, turned on the nonlinear model as the paper turned them on the rig.

    1. P alone: the smallest within 5 % of the least tracking error that P alone reaches.
    2. D: raised until the overshoot is below a quarter of what is allowed, or, where none does that, the calmest.
    3. I: the smallest that meets the steady-state error without breaking the overshoot; else the one with the least
       error among those that keep the overshoot; else none.

    Source: the paper, section 4.2. Differs from source: "quick" and "calm" are given numbers; the paper judged by eye.
    """
    loop, asked, setpoint = task.loop.first(1), task.requirements, trapezoid()

    def tried(p: np.ndarray, i: np.ndarray, d: np.ndarray) -> Judged:
        p, i, d = np.broadcast_arrays(p, i, d)
        return Judged(*(np.asarray(each)[0] for each in loop.judged(Gains(p, i, d), setpoint)))

    quick = tried(_P, np.zeros(1), np.zeros(1)).rmse_pct
    kp = _P[np.argmax(quick <= _QUICK * quick.min())]
    calm = tried(kp, np.zeros(1), _D).overshoot_pct
    below = calm < 0.25 * asked.overshoot_pct
    kd = _D[np.argmax(below)] if below.any() else _D[np.argmin(calm)]
    end = tried(kp, _I, kd)
    keeps = end.overshoot_pct < asked.overshoot_pct
    exact = keeps & (end.steady_state_error_pct < asked.steady_state_error_pct)
    if exact.any():
        return Gains(float(kp), float(_I[np.argmax(exact)]), float(kd))
    error = np.where(keeps, end.steady_state_error_pct, np.inf)
    return Gains(float(kp), float(_I[np.argmin(error)]) if keeps.any() else 0.0, float(kd))
