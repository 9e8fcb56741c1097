"""What gains are judged on: not one signal, but what a throttle meets in a car, one after the other."""

from __future__ import annotations

import numpy as np

from ...car_log.log import Series
from ...model.linear import MIDDLE
from ..settings import ScenarioSettings
from .loop import Loop
from .setpoint import Setpoint, Stretch, in_turn, stairs, trapezoid

_FINE = 2001  # angles between which the default position is found


def course(loop: Loop, settings: ScenarioSettings, *further: Setpoint) -> Setpoint:
    """The scenarios of a rig in turn: the paper's trapezoid, large steps, small ones, across the limp-home position.

    Args:
        loop: of the nominal model first, which says where its plate rests.
        settings: how large, and how long.
        further: more of them, such as a log's own setpoint.
    """
    rest = default_position(loop)
    large = stairs("large steps", (settings.low, settings.high, settings.low), settings.large_hold, settings.lead)
    small = stairs("small steps", _there_and_back(settings.small), settings.hold, settings.lead)
    every = [large, small]
    if rest is not None:
        beyond = settings.beyond_rest
        across = (rest - beyond, rest + beyond, rest - beyond)
        every.append(stairs("across the limp-home position", across, settings.hold, settings.lead))
    return in_turn(trapezoid(), *every, *further)


def _there_and_back(sizes: tuple[float, ...]) -> list[float]:
    """From the middle up by each size and down again, shares of the travel."""
    return [MIDDLE, *(share for size in sizes for share in (MIDDLE + size, MIDDLE))]


def of_log(setpoint: Series, settings: ScenarioSettings) -> Setpoint:
    """The stretch of a log's setpoint in which most is asked, straight between its samples, followed but not judged.

    Args:
        setpoint: per cent of the travel; beyond the stops it is at them.
        settings: how long.
    """
    begin = setpoint.busiest(settings.log)
    inside = (setpoint.time > begin) & (setpoint.time < begin + settings.log)
    times = np.concatenate(([begin], setpoint.time[inside], [begin + settings.log])) - begin + settings.lead
    shares = np.clip(0.01 * np.interp(times - settings.lead + begin, setpoint.time, setpoint.value), 0.0, 1.0)
    tracked = Stretch(settings.lead, settings.lead + settings.log, "log")
    return Setpoint((0.0, *times.tolist()), (float(shares[0]), *shares.tolist()), (), (tracked,))


def default_position(loop: Loop) -> float | None:
    """Share of the travel at which the nominal plate rests without a voltage; None where that is at a stop."""
    shares = np.linspace(0.0, 1.0, _FINE)
    volts = loop.holds(loop.angle(shares)).middle
    crosses = np.flatnonzero((volts[:-1] < 0.0) & (volts[1:] >= 0.0))
    if not crosses.size:
        return None
    k = int(crosses[0])
    return float(np.interp(0.0, volts[k : k + 2], shares[k : k + 2]))
