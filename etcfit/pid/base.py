"""What a tuning rule is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ..ecu import Ecu
from ..linear import TransferFunction
from ..parameters import Scalar

if TYPE_CHECKING:
    from .loop import Loop

UNIT = "V/rad"  # of Kp; Ki is per s, Kd times s


class Gains(NamedTuple):
    """v = Kp e + Ki int e dt + Kd de/dt, e the angle's error.

    Args:
        Kp: V/rad.
        Ki: V/(rad s).
        Kd: V s/rad.
    """

    Kp: Scalar
    Ki: Scalar
    Kd: Scalar

    @classmethod
    def standard(cls, Kp: float, Ti: float, Td: float) -> Gains:
        """Of the form Kp (1 + 1/(Ti s) + Td s), times in s."""
        return cls(Kp, Kp / Ti, Kp * Td)

    @classmethod
    def series(cls, Kc: float, Ti: float, Td: float) -> Gains:
        """Of the form Kc (1 + 1/(Ti s)) (1 + Td s), times in s."""
        return cls(Kc * (1.0 + Td / Ti), Kc / Ti, Kc * Td)


@dataclass(frozen=True)
class Requirements:
    """What a response must stay below; the defaults are the paper's, section 4.1.

    Args:
        overshoot_pct: of the change of the setpoint.
        settling_s: from where the setpoint begins to change until the angle stays within 2 % of the change.
        steady_state_error_pct: of the change.
        gain_margin_db, phase_margin_deg: at least; asked of the optimum only, the paper has none.
    """

    overshoot_pct: float = 20.0
    settling_s: float = 0.2
    steady_state_error_pct: float = 0.5
    gain_margin_db: float = 6.0
    phase_margin_deg: float = 30.0


class Metrics(NamedTuple):
    """How well a loop follows its setpoint.

    Args:
        overshoot_pct: largest excess beyond a new level, of the change of the setpoint.
        settling_s: see `Requirements`; infinite where it does not settle before the setpoint changes again.
        steady_state_error_pct: largest error in the last quarter of a level, of the change.
        rmse_pct: of the tracking error, of the travel (the paper's Eq. 9).
        gain_margin_db, phase_margin_deg: of the linear loop; below 0 where it is unstable.
    """

    overshoot_pct: Scalar
    settling_s: Scalar
    steady_state_error_pct: Scalar
    rmse_pct: Scalar
    gain_margin_db: Scalar
    phase_margin_deg: Scalar


REQUIRED = ("overshoot_pct", "settling_s", "steady_state_error_pct")


@dataclass(frozen=True)
class Refusal:
    """Why a rule has no gains for this plant."""

    why: str


@dataclass(frozen=True, eq=False)
class Task:
    """What a rule may use.

    Args:
        plant: linear, rad/V, with what delays it.
        ecu: the controller's own limits.
        requirements: what is asked for.
        loop: the fitted nonlinear plant under its ECU, nominal model first, then draws.
        as_found: gains of the ECU that drove the logs, or why nobody knows them.
    """

    plant: TransferFunction
    ecu: Ecu
    requirements: Requirements
    loop: Loop
    as_found: Gains | Refusal = Refusal("no ECU is described")


Rule = Callable[[Task], Gains | Refusal]
