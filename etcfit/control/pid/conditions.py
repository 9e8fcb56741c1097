"""The scenarios and conditions of a car under which gains are tried, and the hunting caused by dry friction.

Gains that look good on a transfer function may hunt on a rig (`stuck`): within e_f = V_f / Kp of its setpoint the plate
sticks, V_f being the dry friction in volts at the terminals. There only the integral moves the plate, and to reverse it
the integral must cross 2 V_f, which at an error e takes t_f = 2 V_f / (Ki e). A transfer function has V_f = 0.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ...car_log.log import Series
from ...model.linear import MIDDLE
from ...model.parameters import Scalar
from ...model.pid import Gains
from ...model.throttle import Throttle
from ..setpoint import Setpoint, Stretch, in_turn, stairs, trapezoid
from ..settings import ConditionSettings, ScenarioSettings
from .loop import Loop

LEAD = 0.3  # s at the first level of a scenario, not judged
BEYOND_REST = 0.02  # distance of the steps across the limp-home position beyond it, share of the travel
LARGE_HOLD = 0.5  # s: duration of each large step
_HOLD = 0.4  # s: duration of each other step
_FINE = 2001  # number of angles between which the default position is found


def course(loop: Loop, settings: ScenarioSettings, *further: Setpoint) -> Setpoint:
    """The scenarios of a rig in turn: the paper's trapezoid, large steps, small ones, across the limp-home position.

    Args:
        loop: the nominal model first, which determines the limp-home position.
        further: further scenarios, such as the setpoint of a log.
    """
    rest = default_position(loop)
    large = stairs("large steps", (settings.low, settings.high, settings.low), LARGE_HOLD, LEAD)
    sizes = [MIDDLE, *(share for size in settings.small for share in (MIDDLE + size, MIDDLE))]  # up by each, and back
    small = stairs("small steps", sizes, _HOLD, LEAD)
    every = [large, small]
    if rest is not None:
        across = (rest - BEYOND_REST, rest + BEYOND_REST, rest - BEYOND_REST)
        every.append(stairs("across the limp-home position", across, _HOLD, LEAD))
    return in_turn(trapezoid(), *every, *further)


def of_log(setpoint: Series, settings: ScenarioSettings) -> Setpoint:
    """The stretch of a log's setpoint that moves furthest, linear between its samples. Tracking is evaluated on it, but
    it has no levels.

    Args:
        setpoint: per cent of the travel; it is clipped to the stops.
    """
    begin = setpoint.busiest(settings.log)
    inside = (setpoint.time > begin) & (setpoint.time < begin + settings.log)
    times = np.concatenate(([begin], setpoint.time[inside], [begin + settings.log])) - begin + LEAD
    shares = np.clip(0.01 * np.interp(times - LEAD + begin, setpoint.time, setpoint.value), 0.0, 1.0)
    tracked = Stretch(LEAD, LEAD + settings.log, "log")
    return Setpoint((0.0, *times.tolist()), (float(shares[0]), *shares.tolist()), (), (tracked,))


def default_position(loop: Loop) -> float | None:
    """Share of the travel at which the nominal plate rests without a voltage; None where it rests at a stop."""
    shares = np.linspace(0.0, 1.0, _FINE)
    volts = loop.holds(loop.angle(shares)).middle
    crosses = np.flatnonzero((volts[:-1] < 0.0) & (volts[1:] >= 0.0))
    if not crosses.size:
        return None
    k = int(crosses[0])
    return float(np.interp(0.0, volts[k : k + 2], shares[k : k + 2]))


DRY_FRICTION = ("T_f", "T_s", "T_m", "mu_g", "T_z")  # all parameters that scale with dry friction
COPPER = 0.00393  # temperature coefficient of the resistance of copper, 1/K, at 20 degrees Celsius


class Conditions(NamedTuple):
    """Conditions of one model, or of each of many, shape (D,)."""

    supply: Scalar  # V
    winding: Scalar  # temperature, degrees Celsius
    friction: Scalar  # dry friction over that of the bench


def corners(settings: ConditionSettings) -> Conditions:
    """Every corner of the ranges, shape (8,) each."""
    ends = product(settings.supply, settings.winding, settings.friction)
    return Conditions(*np.array(list(ends)).T)


def scattered(settings: ConditionSettings, count: int, rng: np.random.Generator) -> Conditions:
    """Random conditions, uniform over the ranges, shape (count,) each."""
    every = (settings.supply, settings.winding, settings.friction)
    return Conditions(*(rng.uniform(low, high, count) for low, high in every))


def under(loop: Loop, conditions: Conditions, settings: ConditionSettings) -> Loop:
    """The loop with each model under its own condition.

        v = duty V_supply,    R = R_a (1 + alpha (T - T_bench)),    T_f, ... times the factor

    The ECU does not know the supply: its duty is a share of the actual supply. An ECU that divides by the battery
        voltage
    puts out the intended voltage, up to its largest duty of that supply. The magnets do not change.

    Args:
        loop: D models.
        conditions: shape (D,) each.
    """
    warmer = 1.0 + COPPER * (conditions.winding - settings.bench)
    drive = np.ones(loop.draws) if loop.drive is None else loop.drive
    throttles = scaled(loop.throttles, {"R_a": warmer, **dict.fromkeys(DRY_FRICTION, conditions.friction)})
    if loop.ecu.compensated:
        return replace(loop, throttles=throttles, ceiling=loop.ecu.duty * np.asarray(conditions.supply))
    return replace(loop, throttles=throttles, drive=drive * conditions.supply / loop.ecu.supply)


def at_corners(loop: Loop, settings: ConditionSettings) -> Loop:
    """The nominal model at every corner of the ranges."""
    there = corners(settings)
    return under(loop.taking(np.zeros(there.supply.size, dtype=int)), there, settings)


def scaled(throttle: Throttle, factors: dict[str, Any]) -> Throttle:
    """Models with some parameters of all their effects multiplied by factors."""

    def each(effect: Any) -> Any:
        changed = {name: factor * getattr(effect, name) for name, factor in factors.items() if hasattr(effect, name)}
        return replace(effect, **changed) if changed else effect

    return replace(throttle, effects=tuple(each(effect) for effect in throttle.effects))


class Stuck(NamedTuple):
    """The effect of dry friction on a loop."""

    error_pct: float  # e_f, % of the travel: the error that the proportional part alone leaves
    wait_s: float  # t_f, time from sticking this far beyond the setpoint until the integral reverses the plate, s


def stuck(loop: Loop, gains: Gains) -> Stuck:
    """The effect of dry friction on the nominal plate of a loop at `MIDDLE` of its travel.

    Source: Olsson and Astrom 2001, IEEE Trans. Control Systems Technology 9(4) (hunting). Differs from source: the
    waiting time is for a plate that sticks at the edge of the band.
    """
    down, _, up = loop.holds(np.array([loop.angle(MIDDLE)]))
    friction = 0.5 * float(up[0] - down[0])
    error = friction / float(gains.Kp)
    wait = 2.0 * friction / (float(gains.Ki) * error) if gains.Ki else float("inf")
    return Stuck(100.0 * error / (loop.body.upper - loop.body.lower), wait)
