"""What a stuck, dropped-out or offset position sensor does before a check opens the bridge."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...model.linear import MIDDLE
from ..pid.base import Task
from ..pid.gains import Gains
from ..pid.loop import Loop
from .guarded import Guards, Seen, SensorFault, Trial, of_setpoint
from .jam import JamCheck


@dataclass(frozen=True)
class Runaway:
    """A sensor that fails while a quarter of the travel is asked for; the worst of all models.

    Args:
        fault: in words.
        asked: setpoint since then, share of the travel.
        opens: widest opening that no check stops, share of the travel.
        jam_after: s until the jam check has told it in every model; None where in one it does not.
        jam_opens: widest opening with that check, share of the travel.
        apart_after, apart_opens: likewise with the check of two sensors against each other beside it.
    """

    fault: str
    asked: float
    opens: float
    jam_after: float | None
    jam_opens: float
    apart_after: float | None
    apart_opens: float


def faults(task: Task) -> Iterator[tuple[str, SensorFault, float]]:
    """Each in words, and the setpoint asked for as of then."""
    settings, body = task.settings.safety, task.loop.body
    travel = body.upper - body.lower
    for step in settings.frozen:
        stuck = SensorFault(settings.lead, kept=0.0, frozen=1.0)
        yield f"frozen, {100.0 * step:g} % more asked for", stuck, MIDDLE + step
    yield "shows the closed stop", SensorFault(settings.lead, kept=0.0, shift=body.lower), MIDDLE
    yield "shows the open stop", SensorFault(settings.lead, kept=0.0, shift=body.upper), MIDDLE
    low = SensorFault(settings.lead, shift=-settings.offset * travel)
    yield f"one of two reads {100.0 * settings.offset:g} % too little", low, MIDDLE


def guards_of(task: Task, check: JamCheck | None) -> tuple[Guards, Guards, Guards]:
    """None, the jam check, and beside it that of two sensors."""
    settings, travel = task.settings.safety, task.loop.body.upper - task.loop.body.lower
    jam = Guards() if check is None else Guards(check.error * travel, check.timeout)
    return Guards(), jam, jam._replace(apart=settings.apart * travel, apart_for=settings.apart_for)


def trials(loop: Loop, task: Task, gains: Gains, check: JamCheck | None, ticks: int) -> list[Trial]:
    """Each fault under each set of checks."""
    settings = task.settings.safety
    time = task.ecu.period * np.arange(ticks)
    supply = settings.supply / task.ecu.supply
    return [
        of_setpoint(loop, gains, np.where(time < settings.lead - 1e-9, MIDDLE, asked), fault, guards, supply)
        for _, fault, asked in faults(task)
        for guards in guards_of(task, check)
    ]


def runaways(loop: Loop, task: Task, seen: Seen) -> tuple[Runaway, ...]:
    """What became of the trials."""
    begin = math.ceil(task.settings.safety.lead / task.ecu.period - 1e-9)
    position = loop.share(seen.position)
    widest = np.max(position[..., begin:], axis=(0, 2))
    after = _after(seen.tripped[..., begin:], task.ecu.period)
    return tuple(
        Runaway(fault, asked, float(widest[k]), after[k + 1], float(widest[k + 1]), after[k + 2], float(widest[k + 2]))
        for k, (fault, _, asked) in zip(range(0, widest.size, 3), faults(task), strict=True)
    )


def _after(tripped: np.ndarray, period: float) -> list[float | None]:
    """s until a check has told in every model, by trial."""
    when = np.where(np.any(tripped > 0.0, axis=-1), np.argmax(tripped > 0.0, axis=-1), -1)
    return [None if np.any(each < 0) else float(period * np.max(each)) for each in when.T]
