"""What a supply that sags does to a plate held still: how far it moves, when it is back, what the integral gathers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..pid.base import Task
from ..pid.gains import Gains
from ..pid.loop import Loop
from .guarded import Seen, Trial, longest_above, of_setpoint
from .jam import JamCheck


@dataclass(frozen=True)
class Sag:
    """A sag of the supply while an opening is held; the worst of all models.

    Args:
        name: "dip" or "crank".
        opening: held, share of the travel.
        closes: by how much the plate falls, share of the travel.
        opens: by how much it then overshoots, likewise.
        back_after: s from the supply's return until the plate stays near its setpoint; None for not while watched.
        wound: largest change of the integral, share of the ECU's supply.
        false_trip: whether the proposed jam check would take it for a jam; None where none is proposed.
    """

    name: str
    opening: float
    closes: float
    opens: float
    back_after: float | None
    wound: float
    false_trip: bool | None


def profiles(task: Task, ticks: int) -> Iterator[tuple[str, np.ndarray, float]]:
    """Each sag: its name, the supply over the ECU's own at each tick, when it is over (s)."""
    settings, ecu = task.settings.safety, task.ecu
    time = ecu.period * np.arange(ticks) + 1e-9
    for name, volts, spans in (("dip", (settings.dip,), (settings.dip_for,)),
                               ("crank", settings.crank, settings.crank_for)):  # fmt: skip
        ends = settings.lead + np.cumsum((0.0, *spans))
        levels = np.array([ecu.supply, *np.minimum(volts, ecu.supply), ecu.supply])
        yield name, levels[np.searchsorted(ends, time, side="right")] / ecu.supply, float(ends[-1])


def trials(loop: Loop, task: Task, gains: Gains, ticks: int) -> list[Trial]:
    """Each sag at each opening."""
    return [
        of_setpoint(loop, gains, np.full(ticks, opening), supply=supply)
        for _, supply, _ in profiles(task, ticks)
        for opening in task.settings.safety.openings
    ]


def sags(loop: Loop, task: Task, seen: Seen, check: JamCheck | None) -> tuple[Sag, ...]:
    """What became of the trials."""
    names = [(name, over, opening) for name, _, over in profiles(task, seen.position.shape[-1])
             for opening in task.settings.safety.openings]  # fmt: skip
    return tuple(_sag(loop, task, Seen(*(v[:, k] for v in seen)), *named, check) for k, named in enumerate(names))


def _sag(loop: Loop, task: Task, seen: Seen, name: str, over: float, opening: float, check: JamCheck | None) -> Sag:
    """Of one trial on every model, shape (D, K)."""
    settings, period = task.settings.safety, task.ecu.period
    begin, end = (math.ceil(instant / period - 1e-9) for instant in (settings.lead, over))
    off = loop.share(seen.position) - loop.share(seen.position[:, begin])[:, None]
    shown = opening - loop.share(seen.shown[:, begin:])
    far = np.abs(opening - loop.share(seen.position[:, end:])) > settings.recovered
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
