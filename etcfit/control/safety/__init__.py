"""Behaviour of the proposed gains in failures of plate (jam), sensor, supply and current, and their detection."""

from __future__ import annotations

from dataclasses import dataclass

from ...model.linear import MIDDLE
from ...model.pid import Gains
from ..pid.base import Task
from .faults import (
    FAILS_AT,
    WATCHED,
    Envelope,
    JamCheck,
    Runaway,
    Sag,
    envelope,
    propose_jam_check,
    runaways,
    sag_trials,
    sags,
    sensor_trials,
)
from .guarded import Seen, bench_and_extremes, run_trials, stack_trials
from .unpowered import Holding, Return, holding_currents, return_times


@dataclass(frozen=True, eq=False)
class Safety:
    """The results for all failures, and the proposed jam check."""

    envelope: Envelope  # control errors of a sound throttle
    jam: JamCheck | None  # the proposed jam check; None where no threshold allows a timeout within the limit
    sensors: tuple[Runaway, ...]  # faults of the position sensor
    sags: tuple[Sag, ...]  # of the supply
    returns: tuple[Return, ...]  # return of the plate without a current, by opening
    holding: Holding  # current and heat of holding


def safety(task: Task, gains: Gains) -> Safety:
    """The safety figures of these gains; their settings are in `task.settings.safety`."""
    settings = task.settings.safety
    found = envelope(task, gains)
    check = propose_jam_check(found, task)
    loop = bench_and_extremes(task)
    longest = max(settings.dip_for, sum(settings.crank_for))
    ticks = round((FAILS_AT + longest + WATCHED) / task.ecu.period)
    failing = sensor_trials(loop, task, gains, check, ticks)
    every = run_trials(loop, stack_trials([*failing, *sag_trials(loop, task, gains, ticks)]), MIDDLE)
    failed, sagged = (Seen(*(v[:, part] for v in every)) for part in (slice(len(failing)), slice(len(failing), None)))
    return Safety(
        found,
        check,
        runaways(loop, task, failed),
        sags(loop, task, sagged, check),
        return_times(loop, task),
        holding_currents(loop, task),
    )
