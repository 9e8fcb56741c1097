"""Simulates a jam, a failing sensor and a sagging supply for a plate under its PID, and proposes a jam check."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...model.linear import MIDDLE
from ...model.pid import Gains
from ..pid.base import Task
from ..pid.conditions import Conditions, corners, scattered, under
from ..pid.loop import Loop
from ..setpoint import Setpoint
from .guarded import Guards, Seen, SensorFault, Trial, lasted, longest_above, of_setpoint, run_trials, stack_trials

FAILS_AT = 0.6  # s: time of the failure, before which the plate settles
WATCHED = 1.2  # s: simulated time afterwards
_THRESHOLDS = 40  # thresholds that are tried for the jam check, evenly spaced in the logarithm
_LEAST = 0.005  # least threshold of the jam check, share of the travel
_CLOCK = 0.01  # s: a timeout is rounded up to a multiple of this
_RECOVERED = 0.01  # distance from the setpoint within which a plate is back after a dip, share of the travel


@dataclass(frozen=True)
class JamCheck:
    """A proposed pair."""

    error: float  # threshold of the error, share of the travel
    timeout: float  # time above the threshold after which the plate counts as stuck, s
    longest: float  # longest time for which the error of a sound throttle exceeds the threshold, s
    sustained: float  # largest error that a sound throttle has for as long as the timeout, share of the travel
    # detection time of a held plate by scenario, from a change of the setpoint, s; None where that change is too small
    detected_after: dict[str, float | None]


@dataclass(frozen=True, eq=False)
class Envelope:
    """Control errors of a sound throttle, over all scenarios, draws and conditions."""

    errors: np.ndarray  # thresholds of the error, shares of the travel, rising, shape (T,)
    longest: np.ndarray  # longest time for which the error was larger without a break, s, shape (T,)
    models: int  # number of models simulated
    largest: float  # largest error, share of the travel


def envelope(task: Task, gains: Gains) -> Envelope:
    """The envelope of every draw under random conditions and of the nominal model at their corners, in every scenario.

    The error is that of the ECU: setpoint less sensor reading, including noise and lag.
    """
    ranges, settings, setpoint = task.settings.conditions, task.settings.safety, task.setpoint
    draws, ends = task.loop.draws, corners(ranges)
    anywhere = scattered(ranges, draws, np.random.default_rng(ranges.seed))
    conditions = Conditions(*(np.concatenate(each) for each in zip(anywhere, ends, strict=True)))
    which = np.concatenate((np.arange(draws), np.zeros(ends.supply.size, dtype=int)))
    loop = under(task.loop.taking(which), conditions, ranges)
    time = setpoint.instants(task.ecu.period)
    shares = setpoint.at(time)
    seen = run_trials(loop, stack_trials([of_setpoint(loop, gains, shares)]), float(shares[0]))
    error = (shares - loop.share(seen.shown[:, 0]))[:, time >= setpoint.judged_from]
    errors = np.geomspace(_LEAST, settings.most, _THRESHOLDS)
    longest = task.ecu.period * np.array([np.max(longest_above(error, level)) for level in errors])
    return Envelope(errors, longest, loop.draws, float(np.max(np.abs(error))))


def propose_jam_check(found: Envelope, task: Task) -> JamCheck | None:
    """The check with the least threshold whose timeout, with a reserve, is short enough; None where there is none."""
    settings, period = task.settings.safety, task.ecu.period
    needed = np.maximum(settings.reserve * found.longest, period)
    timeouts = _CLOCK * np.ceil(needed / _CLOCK - 1e-9)
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


@dataclass(frozen=True)
class Runaway:
    """A sensor that fails at a setpoint of a quarter of the travel; the worst of all models."""

    fault: str  # in words
    setpoint: float  # setpoint after the failure, share of the travel
    opens: float  # widest opening without a check, share of the travel
    jam_after: float | None  # time until the jam check has detected it in every model, s; None where it misses one
    jam_opens: float  # widest opening with that check, share of the travel
    # apart_after, apart_opens: likewise with the comparison of two sensors as a second check
    apart_after: float | None
    apart_opens: float


def faults(task: Task) -> Iterator[tuple[str, SensorFault, float]]:
    """The sensor faults: each in words, the fault, and the setpoint after it."""
    settings, body = task.settings.safety, task.loop.body
    travel = body.upper - body.lower
    for step in settings.frozen:
        stuck = SensorFault(FAILS_AT, kept=0.0, frozen=1.0)
        yield f"frozen, {100.0 * step:g} % higher setpoint", stuck, MIDDLE + step
    yield "shows the closed stop", SensorFault(FAILS_AT, kept=0.0, shift=body.lower), MIDDLE
    yield "shows the open stop", SensorFault(FAILS_AT, kept=0.0, shift=body.upper), MIDDLE
    low = SensorFault(FAILS_AT, shift=-settings.offset * travel)
    yield f"one of two reads {100.0 * settings.offset:g} % too little", low, MIDDLE


def sensor_trials(loop: Loop, task: Task, gains: Gains, check: JamCheck | None, ticks: int) -> list[Trial]:
    """Each fault without a check, with the jam check, and with both checks."""
    settings, travel = task.settings.safety, task.loop.body.upper - task.loop.body.lower
    jam = Guards() if check is None else Guards(check.error * travel, check.timeout)
    both = jam._replace(apart=settings.apart * travel, apart_for=settings.apart_for)
    time = task.ecu.period * np.arange(ticks)
    supply = settings.supply / task.ecu.supply
    return [
        of_setpoint(loop, gains, np.where(time < FAILS_AT - 1e-9, MIDDLE, setpoint), fault, guards, supply)
        for _, fault, setpoint in faults(task)
        for guards in (Guards(), jam, both)
    ]


def runaways(loop: Loop, task: Task, seen: Seen) -> tuple[Runaway, ...]:
    """The results of the trials."""
    begin = math.ceil(FAILS_AT / task.ecu.period - 1e-9)
    widest = np.max(loop.share(seen.position)[..., begin:], axis=(0, 2)).tolist()
    tripped = seen.tripped[..., begin:] > 0.0
    when = np.where(np.any(tripped, axis=-1), np.argmax(tripped, axis=-1), -1)
    after = [None if np.any(each < 0) else float(task.ecu.period * np.max(each)) for each in when.T]
    return tuple(
        Runaway(fault, setpoint, widest[k], after[k + 1], widest[k + 1], after[k + 2], widest[k + 2])
        for k, (fault, _, setpoint) in zip(range(0, len(widest), 3), faults(task), strict=True)
    )


@dataclass(frozen=True)
class Sag:
    """A sag of the supply while an opening is held; the worst of all models."""

    name: str  # "dip" or "crank"
    opening: float  # setpoint, share of the travel
    closes: float  # distance by which the plate falls, share of the travel
    opens: float  # distance by which it then overshoots, likewise
    # time from the end of the sag until the plate stays near its setpoint, s; None where it does not in the simulated
    # time
    back_after: float | None
    wound: float  # largest change of the integral, share of the ECU's supply
    false_trip: bool | None  # whether the proposed jam check falsely detects a jam; None where none is proposed


def profiles(task: Task, ticks: int) -> Iterator[tuple[str, np.ndarray, float]]:
    """Each sag: its name, the supply over the nominal one of the ECU at each tick, and its end (s)."""
    settings, ecu = task.settings.safety, task.ecu
    time = ecu.period * np.arange(ticks) + 1e-9
    for name, volts, spans in (("dip", (settings.dip,), (settings.dip_for,)),
                               ("crank", settings.crank, settings.crank_for)):  # fmt: skip
        ends = FAILS_AT + np.cumsum((0.0, *spans))
        levels = np.array([ecu.supply, *np.minimum(volts, ecu.supply), ecu.supply])
        yield name, levels[np.searchsorted(ends, time, side="right")] / ecu.supply, float(ends[-1])


def sag_trials(loop: Loop, task: Task, gains: Gains, ticks: int) -> list[Trial]:
    """Each sag at each opening."""
    return [
        of_setpoint(loop, gains, np.full(ticks, opening), supply=supply)
        for _, supply, _ in profiles(task, ticks)
        for opening in task.settings.safety.openings
    ]


def sags(loop: Loop, task: Task, seen: Seen, check: JamCheck | None) -> tuple[Sag, ...]:
    """The results of the trials."""
    names = [(name, over, opening) for name, _, over in profiles(task, seen.position.shape[-1])
             for opening in task.settings.safety.openings]  # fmt: skip
    return tuple(_sag(loop, task, Seen(*(v[:, k] for v in seen)), *named, check) for k, named in enumerate(names))


def _sag(loop: Loop, task: Task, seen: Seen, name: str, over: float, opening: float, check: JamCheck | None) -> Sag:
    """The result of one trial on all models, shape (D, K)."""
    period = task.ecu.period
    begin, end = (math.ceil(instant / period - 1e-9) for instant in (FAILS_AT, over))
    off = loop.share(seen.position) - loop.share(seen.position[:, begin])[:, None]
    shown = opening - loop.share(seen.shown[:, begin:])
    far = np.abs(opening - loop.share(seen.position[:, end:])) > _RECOVERED
    last = far.shape[-1] - np.argmax(far[:, ::-1], axis=-1)
    back = np.where(far.any(axis=-1), last, 0)
    wound = np.max(np.abs(seen.integral[:, begin:] - seen.integral[:, begin][:, None])) / task.ecu.supply
    trips = None if check is None else bool(
        np.any(period * longest_above(shown, check.error) > check.timeout + 1e-9))  # fmt: skip
    return Sag(
        name,
        opening,
        float(np.max(-off[:, begin:])),
        float(np.max(off[:, begin:])),
        None if np.any(back == far.shape[-1]) else float(period * np.max(back)),
        float(wound),
        trips,
    )
