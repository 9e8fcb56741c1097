"""Ticks of an ECU that is part of the model, as columns over the integration steps of a trace.

Each tick begins a step, because the ECU's output jumps there. The clock begins with the trace. Its phase is unknown and
matters only where the setpoint jumps: there the clock begins again, in step with the instant at which the jump was
read.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from ..model.ecu import BiasPoints, Ecu
from .breaks import Breaks
from .setpoint import SAME_INSTANT, Setpoint
from .trace import Trace

_NEAR = 0.1  # share of a period: a tick so near to a sample is moved to it,
_AFTER = 1e-7  # s, just after it, so that a small change of the clock moves the tick and not the sample
_LEAST = 0.5  # least time between two ticks, in periods
_ROUNDING = 1e-6  # margin for rounding in the number of periods of an interval, in periods


def tick_instants(setpoint: Setpoint, ecu: Ecu) -> Float[np.ndarray, " ticks"]:
    """Instants at which the output of the ECU changes, s."""
    t, period = setpoint.instants, ecu.period
    anchors = [t[0]]
    for instant in setpoint.seen + ecu.delay:
        if anchors[-1] + _LEAST * period < instant < t[-1]:
            anchors.append(instant)
    runs = [np.arange(a, b - _LEAST * period, period) for a, b in pairwise([*anchors, t[-1]])]
    ticks = np.concatenate(runs)
    nearest = t[np.clip(np.searchsorted(0.5 * (t[1:] + t[:-1]), ticks), 0, t.size - 1)]
    with_it = (np.abs(nearest - ticks) < _NEAR * period) & ~np.isin(ticks, anchors)
    return np.unique(np.where(with_it, nearest + _AFTER, ticks))


def broken(
    trace: Trace, setpoint: Setpoint, substeps: Int[np.ndarray, " intervals"], ecu: Ecu
) -> tuple[Breaks, Float[np.ndarray, " ticks"]]:
    """The steps of a trace with an ECU, and its ticks, s.

    There is space for a further tick wherever a jump may act, so that the number of steps nearly always stays the same
    when ticks move; rounding may put two ticks into an interval that is slightly shorter than their period.

    Args:
        setpoint: setpoint of the ECU.
        substeps: least number of steps of each interval.
        ecu: its clock.
    """
    t, ticks = trace.instants, tick_instants(setpoint, ecu)
    inner = ticks[~np.isin(ticks, t)]
    home = np.searchsorted(t, inner) - 1
    count = np.bincount(home, minlength=t.size - 1)
    room = np.ceil(np.diff(t) / ecu.period - _ROUNDING).astype(int)
    acts = t[setpoint.jumps] + ecu.delay
    begins, ends = (np.searchsorted(t, each, side="right") - 1 for each in (acts, acts + setpoint.windows))
    for begin, end in zip(begins, ends, strict=True):
        room[begin : end + 1] += 1
    room = np.maximum(np.maximum(room, 0), count)
    pieces = _filled(t, inner, home, room)
    parts = np.repeat(-(-substeps // (room + 1)), room + 1)
    interval = np.repeat(np.repeat(np.arange(t.size - 1), room + 1), parts)
    place = np.arange(interval.size) - np.repeat(np.cumsum(parts) - parts, parts) + 1
    begin, end = (np.repeat(each, parts) for each in (pieces[:-1], pieces[1:]))
    ends = np.where(place == np.repeat(parts, parts), end, begin + (end - begin) * place / np.repeat(parts, parts))
    marks = np.concatenate(([0], np.cumsum(np.add.reduceat(parts, np.cumsum(room + 1) - (room + 1)))))
    return Breaks(np.concatenate((t[:1], ends)), np.concatenate(([0], interval)), marks), ticks


def _filled(
    t: Float[np.ndarray, " n"],
    inner: Float[np.ndarray, " inner"],
    home: Int[np.ndarray, " inner"],
    room: Int[np.ndarray, " intervals"],
) -> Float[np.ndarray, " pieces"]:
    """Instants and ticks between them, with the unused space of each interval divided over its last piece.

    Args:
        t: instants, s.
        inner: ticks between them, s.
        home: the interval of each of these ticks.
        room: number of ticks for which each interval has space.
    """
    count = np.bincount(home, minlength=room.size)
    last = t[:-1].copy()
    np.maximum.at(last, home, inner)
    spare = room - count
    where = np.repeat(np.arange(room.size), spare)
    place = np.arange(where.size) - np.repeat(np.cumsum(spare) - spare, spare) + 1
    fillers = last[where] + (t[1:][where] - last[where]) * place / (spare[where] + 1)
    return np.sort(np.concatenate((t, inner, fillers)))


def commands(
    setpoint: Setpoint,
    origin: float,
    ends: Float[np.ndarray, " rows"],
    ticks: Float[np.ndarray, " ticks"],
    ecu: Ecu,
    bias: BiasPoints,
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Columns of `Command`, and of `Disturbance` for the jumps of the setpoint.

    Args:
        setpoint: setpoint of the ECU.
        origin: angle at which the trace begins, rad.
        ends: ends of the steps, s.
        ticks: ticks of the ECU, s.
        ecu: its delay.
        bias: its feed-forward, see `RigConfig`.
    """
    begins = np.concatenate(([np.nan], ends[:-1]))  # the first entry is the start itself
    tick = np.isin(begins, ticks)
    read = setpoint.at(np.nan_to_num(begins, nan=ends[0]) - ecu.delay + SAME_INSTANT)
    always = np.ones(ends.size)
    points = np.array(bias if bias else ((0.0, 0.0),))
    ahead = np.interp(read, points[:, 0], points[:, 1])
    command = {"active": always, "tick": tick * 1.0, "setpoint": read, "ahead": ahead, "origin": origin * always}
    return command | _moved_with_jumps(setpoint, ends, tick, ecu)


def _moved_with_jumps(
    setpoint: Setpoint, ends: Float[np.ndarray, " rows"], tick: Bool[np.ndarray, " rows"], ecu: Ecu
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Columns of `Disturbance`: a later jump lengthens the step before it, and shifts the ticks after it."""
    seen, follows = np.zeros(ends.size), np.zeros(ends.size)
    before_tick = np.append(tick[1:], False)
    rows = np.searchsorted(ends, setpoint.seen + ecu.delay - SAME_INSTANT)  # steps that end when a jump is read
    inside = (rows > 1) & (rows < ends.size - 1)
    rows, sd = rows[inside], setpoint.seen_sd[inside]
    for row, last in pairwise([*rows, ends.size]):
        stretch = slice(row + 1, last)
        follows[stretch] = before_tick[stretch] * 1.0 - tick[stretch]
        if last < ends.size and tick[last]:  # the step after this tick belongs to the next jump: the tick stays
            follows[last - 1] -= 1.0
    follows[rows] = 1.0
    seen[rows - 1] = sd**2
    return {"seen": seen, "follows": follows}
