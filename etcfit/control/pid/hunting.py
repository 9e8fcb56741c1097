"""Why gains that look good on a transfer function hunt on a rig with dry friction.

Within e_f = V_f / Kp of its setpoint the plate sticks, whatever the proportional part asks for: V_f is the dry
friction in volts at the terminals. There only the integral moves it, and to turn the plate round it must cross 2 V_f,
which at an error e takes t_f = 2 V_f / (Ki e). A transfer function has V_f = 0 and knows of neither.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...model.linear import MIDDLE
from .gains import Gains
from .loop import Loop


class Stuck(NamedTuple):
    """What dry friction makes of gains.

    Args:
        error_pct: e_f, % of the travel: the error that the proportional part alone leaves.
        wait_s: t_f, from sticking that far beyond the setpoint until the integral has turned the plate round, s.
    """

    error_pct: float
    wait_s: float


def stuck(loop: Loop, gains: Gains, share: float = MIDDLE) -> Stuck:
    """The nominal plate of a loop at a share of its travel.

    Source: Olsson and Astrom 2001, IEEE Trans. Control Systems Technology 9(4) (hunting). Differs from source: the
    waiting time is that of a plate stuck at the edge of the band.
    """
    down, _, up = loop.holds(np.array([loop.angle(share)]))
    friction = 0.5 * float(up[0] - down[0])
    error = friction / float(gains.Kp)
    wait = 2.0 * friction / (float(gains.Ki) * error) if gains.Ki else float("inf")
    return Stuck(100.0 * error / (loop.body.upper - loop.body.lower), wait)
