"""The paper's manual procedure, automated."""

from __future__ import annotations

import numpy as np

from ..settings import ManualSettings
from .base import Refusal, Task
from .figures import LoopFigures
from .gains import Gains
from .setpoint import trapezoid


def manual(task: Task) -> Gains | Refusal:
    """P until quick, D until calm, then a little I, turned on the nonlinear model as the paper turned them on the rig.

    1. P alone: the smallest within 5 % of the least tracking error that P alone reaches.
    2. D: raised until the overshoot is below a quarter of what is allowed, or, where none does that, the calmest.
    3. I: the smallest that meets the steady-state error without breaking the overshoot; else the one with the least
       error among those that keep the overshoot; else none.

    Source: the paper, section 4.2. Differs from source: "quick" and "calm" are given numbers; the paper judged by eye.
    """
    loop, asked, setpoint = task.loop.first(1), task.requirements, trapezoid()
    settings = task.settings.manual
    proportional, integral, derivative = grids(settings)

    def tried(p: np.ndarray, i: np.ndarray, d: np.ndarray) -> LoopFigures:
        p, i, d = np.broadcast_arrays(p, i, d)
        return loop.judged(Gains(p, i, d), setpoint).each(lambda figure: np.asarray(figure)[0])

    quick = tried(proportional, np.zeros(1), np.zeros(1)).rmse_pct
    kp = proportional[np.argmax(quick <= settings.quick * quick.min())]
    if kp == proportional[-1]:
        return Refusal(f"P alone tracks best at the largest gain tried, {kp:g} V/rad: raise highest in ManualSettings")
    calm = tried(kp, np.zeros(1), derivative).overshoot_pct
    below = calm < settings.calm * asked.overshoot_pct
    kd = derivative[np.argmax(below)] if below.any() else derivative[np.argmin(calm)]
    end = tried(kp, integral, kd)
    keeps = end.overshoot_pct < asked.overshoot_pct
    exact = keeps & (end.steady_state_error_pct < asked.steady_state_error_pct)
    if exact.any():
        return Gains(float(kp), float(integral[np.argmax(exact)]), float(kd))
    error = np.where(keeps, end.steady_state_error_pct, np.inf)
    return Gains(float(kp), float(integral[np.argmin(error)]) if keeps.any() else 0.0, float(kd))


def grids(settings: ManualSettings) -> Gains:
    """Values of each gain that are tried, rising, shape (count,) each: V/rad, V/(rad s) and V s/rad."""
    (p, i, d), (p_end, i_end, d_end), n = settings.lowest, settings.highest, settings.count
    return Gains(
        np.geomspace(p, p_end, n),
        np.concatenate(([0.0], np.geomspace(i, i_end, n - 1))),
        np.concatenate(([0.0], np.geomspace(d, d_end, n - 1))),
    )
