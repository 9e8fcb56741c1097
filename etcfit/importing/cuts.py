"""Where one recording holds several traces: the clock begins anew or pauses, the rig rests, the plate is let go."""

from __future__ import annotations

import numpy as np

from ..errors import MeasurementError
from . import shapes
from .record import Record, let_go
from .settings import GuessSettings


def cut(record: Record, settings: GuessSettings) -> list[Record]:
    """The traces that a record holds, in order; itself alone where it holds one.

    Raises:
        MeasurementError: every stretch of it is too short to be one.
    """
    pieces = [part for piece in _by_clock(record, settings) for part in _by_pause(piece, settings)]
    if not pieces:
        raise MeasurementError(record.sheet.where, "its time falls or pauses before there are "
                               f"{settings.fewest} rows in a row.", f"A trace needs {settings.fewest} rows.",
                               "Export the trace again, its rows in the order of time.")  # fmt: skip
    return [
        part
        for piece in pieces
        for part in (_by_release(piece, settings) if let_go(piece, settings) else _by_rest(piece, settings))
    ]


def _by_clock(record: Record, settings: GuessSettings) -> list[Record]:
    """Several runs, one below the other."""
    time, first, starts = record.time, 0, [0]
    for k in np.flatnonzero(np.diff(time) <= 0.0) + 1:
        if time[k - 1] - time[k] > settings.anew * (time[k - 1] - time[first]):
            first = int(k)
            starts.append(first)
    return _pieces(record, starts, "its clock begins anew", settings)


def _by_pause(record: Record, settings: GuessSettings) -> list[Record]:
    steps = np.diff(record.time)
    if steps.size < settings.fewest:
        return [record]
    pauses = np.flatnonzero(steps > max(settings.pause * float(np.median(steps)), settings.pause_s)) + 1
    return _pieces(record, [0, *map(int, pauses)], "a pause without samples", settings)


def _pieces(record: Record, starts: list[int], why: str, settings: GuessSettings) -> list[Record]:
    if len(starts) == 1:
        return [record]
    pieces = list(zip(starts, [*starts[1:], record.time.size], strict=True))
    short = sum(b - a for a, b in pieces if b - a < settings.fewest)
    why = f"{why}; {short} rows in pieces of fewer than {settings.fewest} are left out" if short else why
    return [record.within(slice(a, b), why) for a, b in pieces if b - a >= settings.fewest]


def _by_rest(record: Record, settings: GuessSettings) -> list[Record]:
    """A driven plate that stood still with nothing on for a second or more: half of the rest to each neighbour."""
    signals, time = record.signals, record.time
    drive = record.drive(signals)
    if drive is None or record.plate(signals) is None or "setpoint" in signals or time.size < settings.fewest:
        return [record]
    level = np.abs(shapes.smooth(drive, 5))
    quiet = level < max(settings.rest_level * float(np.max(level)), 4.0 * shapes.noise(drive))
    rests = [
        (a, b) for a, b in shapes.runs(quiet) if time[b - 1] - time[a] > settings.rest_s and a > 0 and b < time.size
    ]
    starts = [0, *((a + b) // 2 for a, b in rests)]
    ends = [*starts[1:], time.size]
    if len(starts) == 1 or any(time[b - 1] - time[a] < settings.shortest_s for a, b in zip(starts, ends, strict=True)):
        return [record]
    return _pieces(record, starts, "the rig rests at 0 V between them", settings)


def _by_release(record: Record, settings: GuessSettings) -> list[Record]:
    """Each fall of the plate alone, from a while before it until somebody lifts the plate again."""
    signals = record.signals
    plate = record.plate(signals)
    if plate is None:
        return [record]
    level = plate if _falls_first(plate) else -plate
    falls = shapes.falls(level)
    if len(falls) < 2:
        return [record]
    level = shapes.smooth(level, 5)
    ends = [*(high for high, _ in falls[1:]), level.size]
    starts = [
        _held_since(level, after, high, settings)
        for after, (high, _) in zip([0, *(low for _, low in falls[:-1])], falls, strict=True)
    ]
    if not all(
        _is_release(record.time, level, start, fall, settings) for start, fall in zip(starts, falls, strict=True)
    ):
        return [record]  # a plate that somebody drives, unlogged
    kept = [(start, _until_lifted(level, low, before, settings))
            for start, (_, low), before in zip(starts, falls, ends, strict=True)]  # fmt: skip
    why = "the plate is let go several times; lifting it is left out"
    return [record.within(slice(a, b), why) for a, b in kept if b - a >= settings.fewest]


def _is_release(
    time: np.ndarray, level: np.ndarray, start: int, fall: tuple[int, int], settings: GuessSettings
) -> bool:
    """True where the plate stood at its open end, for no shorter than it then took to fall quickly."""
    high, low = fall
    took = float(time[low] - time[high])
    open_ = float(level[start]) > float(np.max(level)) - settings.open_end * shapes.span(level)
    return open_ and took < min(settings.release_s, float(time[high] - time[start]))


def _held_since(level: np.ndarray, after: int, high: int, settings: GuessSettings) -> int:
    """The row from which the plate stood where it was let go."""
    size = shapes.span(level)
    stood = after + int(
        np.flatnonzero(level[after : high + 1] > np.max(level[after : high + 1]) - settings.stands * size)[-1]
    )
    away = np.flatnonzero(np.abs(level[after:stood] - level[stood]) > 1.5 * settings.stands * size)
    return after + int(away[-1]) + 1 if away.size else after


def _until_lifted(level: np.ndarray, low: int, before: int, settings: GuessSettings) -> int:
    """The row before which the plate, once down, is not lifted yet."""
    rest = level[low:before]
    lifted = np.flatnonzero(rest > np.minimum.accumulate(rest) + 3.0 * settings.stands * shapes.span(level))
    if not lifted.size:
        return before
    still = np.flatnonzero(rest[: lifted[0]] < np.min(rest[: lifted[0] + 1]) + settings.stands * shapes.span(level))
    return low + int(still[-1]) + 1


def _falls_first(plate: np.ndarray) -> bool:
    """True where the plate's larger reading is the open one: it is held there before its first quick move."""
    ends = max(1, plate.size // 50)
    return bool(np.mean(plate[:ends]) > np.mean(plate[-ends:]))
