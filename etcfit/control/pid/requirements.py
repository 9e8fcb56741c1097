"""What a response must stay below, and how well one does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ...car_log.criteria import ACTIVITY, HELD, OVERSHOOT, SETTLING
from ...model.parameters import Scalar


@dataclass(frozen=True)
class Requirements:
    """What a response must stay below; the defaults are the paper's, section 4.1.

    Args:
        overshoot_pct: of the change of the setpoint, or of 1 % of the travel where that is more.
        settling_s: from where the setpoint begins to change until the angle stays within 2 % of the change, or within
            0.2 % of the travel where that is more.
        steady_state_error_pct: of the change, or of 40 % of the travel where that is more.
        gain_margin_db, phase_margin_deg: at least; asked of the optimum only, the paper has none.
        duty_activity_pct: standard deviation of the duty while the setpoint rests; the paper has none.
        current_rms_A: over all scenarios; the paper has none.
        winding_W, bridge_W: mean heat in winding and bridge; the paper has none.
    """

    overshoot_pct: float = OVERSHOOT.limit
    settling_s: float = SETTLING.limit
    steady_state_error_pct: float = HELD.limit
    gain_margin_db: float = 6.0
    phase_margin_deg: float = 30.0
    duty_activity_pct: float = ACTIVITY.limit
    current_rms_A: float = math.inf
    winding_W: float = math.inf
    bridge_W: float = math.inf


class Metrics(NamedTuple):
    """How well a loop follows its setpoint, and what that costs.

    Args:
        overshoot_pct: largest excess beyond a new level, of the change of the setpoint.
        settling_s: see `Requirements`; infinite where it does not settle before the setpoint changes again.
        steady_state_error_pct: largest error in the last quarter of a level, of the change.
        rmse_pct: of the tracking error, of the travel (the paper's Eq. 9).
        gain_margin_db, phase_margin_deg: of the linear loop; below 0 where it is unstable.
        duty_activity_pct: standard deviation of the duty in the last quarter of a level, root mean square of all.
        current_rms_A: rms of the current.
        winding_W, bridge_W: mean heat of winding and bridge, R i^2.
    """

    overshoot_pct: Scalar
    settling_s: Scalar
    steady_state_error_pct: Scalar
    rmse_pct: Scalar
    gain_margin_db: Scalar
    phase_margin_deg: Scalar
    duty_activity_pct: Scalar = 0.0
    current_rms_A: Scalar = 0.0
    winding_W: Scalar = 0.0
    bridge_W: Scalar = 0.0


OF_THE_PAPER = ("overshoot_pct", "settling_s", "steady_state_error_pct")
REQUIRED = (*OF_THE_PAPER, "duty_activity_pct", "current_rms_A", "winding_W", "bridge_W")
