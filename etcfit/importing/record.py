"""A stretch of a sheet as signals in SI, for guesses about sign and rig test; and the places at which one recording is
cut into several traces: the clock begins again or pauses, the rig rests, the plate is released.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MeasurementError
from ..rig.signals import runs
from . import shapes
from .sheet import TIME, Sheet
from .take import LEFT_OUT, UNEXPLAINED, Take

FEWEST = 10  # least number of samples of a trace
ONE_LEVEL = 0.05  # relative range of a voltage that counts as one level
RELEASE_S = 0.7  # longest time of a released plate for the middle of its travel
_PAUSE, _PAUSE_S = 50.0, 0.2  # pause between two traces: times the usual step, and seconds, without a sample
_REST_S, _REST_LEVEL = 1.0, 0.03  # rest between two traces: seconds below this share of the largest drive
_SHORTEST_S = 0.3  # least duration of a piece between two rests
_ANEW = 0.5  # share of the elapsed time by which a clock must fall back to count as begun again
_STANDS = 0.02  # share of its range within which a plate counts as standing still
_OPEN_END = 0.1  # share of the range below the top from which a plate is released


@dataclass(frozen=True, eq=False)
class Record:
    """A future trace."""

    sheet: Sheet  # its sheet
    rows: slice  # its rows
    takes: tuple[Take, ...]  # meanings of the sheet's columns, with the time
    cut: str = ""  # why the sheet was cut here; "" if it was not

    @property
    def time(self) -> np.ndarray:
        """s, shape (n,)."""
        return next(take.si for take in self.takes if take.quantity == TIME)[self.rows]

    @property
    def signals(self) -> Mapping[str, np.ndarray]:
        """Signals by quantity, SI, gaps bridged, shape (n,) each; without the time."""
        return {take.quantity: shapes.filled(take.si[self.rows]) for take in self.takes
                if take.quantity not in (LEFT_OUT, TIME)}  # fmt: skip

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Labels of columns that vary and have no known meaning."""
        return tuple(take.column.label for take in self.takes if take.reason == UNEXPLAINED)

    def take(self, quantity: str) -> Take | None:
        """The column of this quantity."""
        return next((take for take in self.takes if take.quantity == quantity), None)

    def with_take(self, new: Take) -> Record:
        """The record with another meaning of one column."""
        return replace(self, takes=tuple(new if take.column is new.column else take for take in self.takes))

    def within(self, rows: slice, cut: str) -> Record:
        """Some of its rows, counted from its own first."""
        first = self.rows.start
        return replace(self, rows=slice(first + rows.start, first + rows.stop), cut=cut)


def plate_of(signals: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Position or sensor volts."""
    return signals.get("position", signals.get("tps"))


def drive_of(
    signals: Mapping[str, np.ndarray], among: Sequence[str] = ("voltage", "duty", "torque")
) -> np.ndarray | None:
    """The motor's input: the first of these that was logged."""
    return next((signals[name] for name in among if name in signals), None)


def whole(sheet: Sheet, takes: Sequence[Take]) -> Record:
    """All rows of a sheet."""
    return Record(sheet, slice(0, sheet.rows), tuple(takes))


def is_release(record: Record) -> bool:
    """Whether the plate is not driven: no input was logged, or a voltage that follows the speed of a released plate.

    A slow ramp of voltage follows a motor's speed as well; but a released plate comes to rest before the log ends.
    """
    signals = record.signals
    plate, voltage = plate_of(signals), signals.get("voltage")
    if plate is None or record.sheet.is_ecu or {"current", "setpoint", "torque", "duty"} & set(signals):
        return False
    if voltage is None:
        return True
    speed = shapes.slope(plate, record.time)
    follows = abs(shapes.correlation(voltage, speed)) > shapes.SURELY_FOLLOWS
    moves = shapes.span(voltage) > 8.0 * shapes.noise(voltage)
    return follows and moves and not _is_step(voltage) and shapes.comes_to_rest(speed)


def _is_step(voltage: np.ndarray) -> bool:
    """Whether a voltage jumps from zero to its top within a sample and stays there, faster than any plate's EMF."""
    size = np.abs(voltage)
    top = float(np.quantile(size, 0.99))
    flat = size > (1.0 - ONE_LEVEL) * top
    jumps = flat[1:] & (size[:-1] < 0.1 * top)
    return bool(jumps.any()) and max(b - a for a, b in runs(flat)) >= FEWEST


def cut(record: Record) -> list[Record]:
    """The traces in a record, in order; the record itself if it holds one.

    Raises:
        MeasurementError: every stretch of it is too short for a trace.
    """
    pieces = [part for piece in _by_clock(record) for part in _by_pause(piece)]
    if not pieces:
        raise MeasurementError(record.sheet.where, f"its time falls or pauses before there are {FEWEST} rows in a row.",
                               f"A trace needs {FEWEST} rows.",
                               "Export the trace again, its rows in the order of time.")  # fmt: skip
    return [part for piece in pieces for part in (_by_release(piece) if is_release(piece) else _by_rest(piece))]


def _by_clock(record: Record) -> list[Record]:
    """Cut where the clock begins again, for several runs one below the other."""
    time, first, starts = record.time, 0, [0]
    for k in np.flatnonzero(np.diff(time) <= 0.0) + 1:
        if time[k - 1] - time[k] > _ANEW * (time[k - 1] - time[first]):
            first = int(k)
            starts.append(first)
    return _pieces(record, starts, "its clock begins anew")


def _by_pause(record: Record) -> list[Record]:
    steps = np.diff(record.time)
    if steps.size < FEWEST:
        return [record]
    pauses = np.flatnonzero(steps > max(_PAUSE * float(np.median(steps)), _PAUSE_S)) + 1
    return _pieces(record, [0, *map(int, pauses)], "a pause without samples")


def _pieces(record: Record, starts: list[int], why: str) -> list[Record]:
    if len(starts) == 1:
        return [record]
    pieces = list(zip(starts, [*starts[1:], record.time.size], strict=True))
    short = sum(b - a for a, b in pieces if b - a < FEWEST)
    why = f"{why}; {short} rows in pieces of fewer than {FEWEST} are left out" if short else why
    return [record.within(slice(a, b), why) for a, b in pieces if b - a >= FEWEST]


def _by_rest(record: Record) -> list[Record]:
    """Cut where a driven plate rested without a drive for a second or more; half of the rest goes to each neighbour."""
    signals, time = record.signals, record.time
    drive = drive_of(signals)
    if drive is None or plate_of(signals) is None or "setpoint" in signals or time.size < FEWEST:
        return [record]
    level = np.abs(shapes.smooth(drive, 5))
    quiet = level < max(_REST_LEVEL * float(np.max(level)), 4.0 * shapes.noise(drive))
    rests = [(a, b) for a, b in runs(quiet) if time[b - 1] - time[a] > _REST_S and a > 0 and b < time.size]
    starts = [0, *((a + b) // 2 for a, b in rests)]
    ends = [*starts[1:], time.size]
    if len(starts) == 1 or any(time[b - 1] - time[a] < _SHORTEST_S for a, b in zip(starts, ends, strict=True)):
        return [record]
    return _pieces(record, starts, "the rig rests at 0 V between them")


def _by_release(record: Record) -> list[Record]:
    """Cut out each fall of the plate, from some time before it until the plate is lifted again."""
    plate = plate_of(record.signals)
    if plate is None:
        return [record]
    ends = max(1, plate.size // 50)
    # the larger reading is the open end if the plate is held there before its first quick move
    level = plate if np.mean(plate[:ends]) > np.mean(plate[-ends:]) else -plate
    falls = shapes.falls(level)
    if len(falls) < 2:
        return [record]
    level = shapes.smooth(level, 5)
    begins = zip([0, *(low for _, low in falls[:-1])], falls, strict=True)
    starts = [_held_since(level, after, high) for after, (high, _) in begins]
    if not all(_is_fall(record.time, level, start, *fall) for start, fall in zip(starts, falls, strict=True)):
        return [record]  # a driven plate whose input was not logged
    before = [*(high for high, _ in falls[1:]), level.size]
    kept = [(start, _until_lifted(level, low, end)) for start, (_, low), end in zip(starts, falls, before, strict=True)]
    why = "the plate is let go several times; lifting it is left out"
    return [record.within(slice(a, b), why) for a, b in kept if b - a >= FEWEST]


def _is_fall(time: np.ndarray, level: np.ndarray, start: int, high: int, low: int) -> bool:
    """Whether the plate stood at its open end for at least the duration of its following quick fall."""
    took = float(time[low] - time[high])
    is_open = float(level[start]) > float(np.max(level)) - _OPEN_END * shapes.span(level)
    return is_open and took < min(RELEASE_S, float(time[high] - time[start]))


def _held_since(level: np.ndarray, after: int, high: int) -> int:
    """The row from which on the plate stood at the place of its release."""
    near, before = _STANDS * shapes.span(level), level[after : high + 1]
    stood = after + int(np.flatnonzero(before > np.max(before) - near)[-1])
    away = np.flatnonzero(np.abs(level[after:stood] - level[stood]) > 1.5 * near)
    return after + int(away[-1]) + 1 if away.size else after


def _until_lifted(level: np.ndarray, low: int, before: int) -> int:
    """The row up to which the fallen plate is not lifted."""
    near, rest = _STANDS * shapes.span(level), level[low:before]
    lifted = np.flatnonzero(rest > np.minimum.accumulate(rest) + 3.0 * near)
    if not lifted.size:
        return before
    still = np.flatnonzero(rest[: lifted[0]] < np.min(rest[: lifted[0] + 1]) + near)
    return low + int(still[-1]) + 1
