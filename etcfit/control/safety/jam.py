"""The jam check: how far off and for how long a sound throttle is at most, and what that leaves for a threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..pid.base import Task
from ..pid.conditions import Conditions, corners, scattered, under
from ..pid.gains import Gains
from ..pid.setpoint import Setpoint
from .guarded import lasted, longest_above, of_setpoint, together, tried


@dataclass(frozen=True)
class JamCheck:
    """A proposed pair.

    Args:
        error: beyond which the plate counts as stuck, share of the travel.
        timeout: after which it does, s.
        longest: for how long a sound throttle is further off, s.
        sustained: error that a sound throttle keeps up for the timeout, share of the travel.
        tells: by scenario, s from a change of the setpoint until a plate that is held where it is is told; None where
            the setpoint does not ask for enough.
    """

    error: float
    timeout: float
    longest: float
    sustained: float
    tells: dict[str, float | None]


@dataclass(frozen=True, eq=False)
class Envelope:
    """How far off a sound throttle is: over all scenarios, draws and conditions.

    Args:
        errors: thresholds, shares of the travel, rising, shape (T,).
        longest: s for which the error was larger without a break, the longest of all, shape (T,).
        models: how many were tried.
        largest: error of all, share of the travel.
    """

    errors: np.ndarray
    longest: np.ndarray
    models: int
    largest: float


def envelope(task: Task, gains: Gains) -> Envelope:
    """Every draw under conditions of its own, and the nominal model at their corners, in every scenario.

    The error is the ECU's own: setpoint less what its sensor shows, noise and lag in it.
    """
    ranges, settings, setpoint = task.settings.conditions, task.settings.safety, task.setpoint
    draws, ends = task.loop.draws, corners(ranges)
    anywhere = scattered(ranges, draws, np.random.default_rng(ranges.seed))
    conditions = Conditions(*(np.concatenate(each) for each in zip(anywhere, ends, strict=True)))
    which = np.concatenate((np.arange(draws), np.zeros(ends.supply.size, dtype=int)))
    loop = under(task.loop.taking(which), conditions, ranges)
    time = setpoint.instants(task.ecu.period)
    asked = setpoint.at(time)
    seen = tried(loop, together([of_setpoint(loop, gains, asked)]), float(asked[0]))
    error = (asked - loop.share(seen.shown[:, 0]))[:, time >= setpoint.judged_from]
    errors = np.geomspace(settings.least, settings.most, settings.count)
    longest = task.ecu.period * np.array([np.max(longest_above(error, level)) for level in errors])
    return Envelope(errors, longest, loop.draws, float(np.max(np.abs(error))))


def proposed(found: Envelope, task: Task) -> JamCheck | None:
    """The least threshold whose timeout, with a reserve, is short enough; None where none is."""
    settings, period = task.settings.safety, task.ecu.period
    needed = np.maximum(settings.reserve * found.longest, period)
    timeouts = settings.clock * np.ceil(needed / settings.clock - 1e-9)
    fit = np.flatnonzero(timeouts <= settings.within + 1e-9)
    if not fit.size:
        return None
    k = int(fit[0])
    error, timeout = float(found.errors[k]), float(timeouts[k])
    lasting = np.flatnonzero(found.longest >= timeout)
    sustained = float(found.errors[lasting[-1]]) if lasting.size else 0.0
    tells = {name: detection_time(task.setpoint, name, error, timeout, period) for name in task.setpoint.scenarios}
    return JamCheck(error, timeout, float(found.longest[k]), sustained, tells)


def detection_time(setpoint: Setpoint, scenario: str, error: float, timeout: float, period: float) -> float | None:
    """Detection time of a plate that has been stuck since the first change of a scenario, s; None if never."""
    levels = setpoint.only(scenario)
    if not levels:
        return None
    time = setpoint.instants(period)
    since = (time >= levels[0].begins - 0.5 * period) & (time < levels[-1].ends - 0.5 * period)
    off = np.abs(setpoint.at(time[since]) - levels[0].before) > error
    trips = np.flatnonzero(period * lasted(off) > timeout + 1e-9)
    return float(period * trips[0]) if trips.size else None
