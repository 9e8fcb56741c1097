"""Finds and refuses copies, cuts and overlaps of one record under two names.

    s_k = sign(y_(k+3) - 3 y_(k+2) + 3 y_(k+1) - y_k)

A measurement never repeats the noise of another one. The signs of a channel's third differences do not change with the
unit, the name, the comments or a shift in time. Where two files share W consecutive signs, including zigzags of noise,
and the values of every common channel agree over the whole overlap of the files, they are one record.

A zigzag is three changes of alternating direction, which a smooth signal never shows, however coarsely it is rounded,
because rounding never turns a rise into a fall; or three third differences of alternating sign, each larger than
rounding alone can cause (4 steps). So plates at rest, constant voltages and noiseless simulations, which may repeat
each other, are not refused; noiseless files that agree in every number are named in a warning.

Records that overlap are found where the head of the later one lies within the earlier one. A copy thinned to every
second row is not found.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from ..errors import MeasurementError, first_names
from .columns import Log

COMMANDED = ("setpoint", "duty", "supply")  # commanded channels may repeat exactly: they have no noise
_ROUNDING = 5.0  # steps; a third difference of rounding errors, at most half a step each, is within 4
WINDOW = 32  # W, number of third differences whose signs are compared first
ZIGZAGS = 8  # least number of zigzags within such a window
GLANCE = 128  # rows at the head of a possible overlap that are compared before the rest
EVIDENCE = 10  # least number of zigzags and lone spikes in the overlap
AGREE = 0.98  # least share of the common rows with equal values; the rest allows for digits lost in writing
DIGITS = 0.02  # allowed difference of equal values, share of the median change from row to row
NAMED = 5  # most copies that a message names
_ODD = np.uint64(0x9E3779B97F4A7C15)  # odd, hence invertible modulo 2^64: the base of the rolling hash


@dataclass(frozen=True, eq=False)
class Shared:
    """Rows `first` + k of one log are rows `second` + k of the other, for k < rows."""

    one: Log
    other: Log
    first: int
    second: int
    rows: int

    @property
    def whole(self) -> bool:
        return self.rows == len(self.one.lines) == len(self.other.lines)


def refuse_duplicates(logs: Sequence[Log]) -> list[str]:
    """Refuse records that are in a folder twice, whole or in part.

    Returns:
        a warning for each file that repeats another one number for number without noise, so that it may be a copy or a
        repeated simulation.

    Raises:
        MeasurementError: names both files, or the first few of many copies.
    """
    for one, other, row, same in _seen_twice(logs):
        before = min(row, same)  # rows in common above the same instant
        rows = before + min(len(one.lines) - row, len(other.lines) - same)
        shared = Shared(one, other, row - before, same - before, rows)
        glance = replace(shared, rows=min(shared.rows, GLANCE))
        if _is_record(glance, 0) and _is_record(shared, EVIDENCE):
            raise _refusal(shared, _copies(shared, logs))
    return _alike(logs)


def _seen_twice(logs: Sequence[Log]) -> Iterator[tuple[Log, Log, int, int]]:
    """Every occurrence of a log's first window of noise in another log: the two logs, and a row of each."""
    names = dict.fromkeys(name for log in logs for name in log.channels if name not in COMMANDED)
    for name in names:
        prints = [_fingerprint(log, name) for log in logs if name in log.channels]
        heads = [(each.hashes[each.head], each, int(each.rows[each.head])) for each in prints if each.head is not None]
        sought = np.unique(np.array([value for value, _, _ in heads], dtype=np.uint64))
        for each in prints if sought.size else ():
            near = sought[np.minimum(np.searchsorted(sought, each.hashes), sought.size - 1)]
            for k in np.flatnonzero(near == each.hashes):
                for value, other, row in heads:
                    if value == each.hashes[k] and other.log is not each.log:
                        yield each.log, other.log, int(each.rows[k]), row


@dataclass(frozen=True, eq=False)
class _Fingerprint:
    """Hash of each window of one channel."""

    log: Log
    rows: np.ndarray  # rows of its samples in the log, shape (n,)
    hashes: np.ndarray  # shape (n - 2 - W,); empty where the channel is shorter
    head: int | None  # the first window with enough noise in it, or None


def _fingerprint(log: Log, name: str) -> _Fingerprint:
    value = log.columns[name].logged * np.sign(log.columns[name].conversion.scale)
    rows = np.flatnonzero(np.isfinite(value))
    value = value[rows]
    if value.size < WINDOW + 3:
        return _Fingerprint(log, rows, np.empty(0, np.uint64), None)
    sums = np.concatenate(([0], np.cumsum(_zigzag(value))))
    noisy = sums[WINDOW:] - sums[:-WINDOW] >= ZIGZAGS
    head = int(np.argmax(noisy)) if noisy.any() else None
    third, exact = np.diff(value, 3), 1e-9 * float(np.max(np.abs(value)))  # units may keep two equal numbers apart
    sign = (third > exact).astype(np.int8) - (third < -exact).astype(np.int8)
    return _Fingerprint(log, rows, _rolling(sign), head)


def _zigzag(value: np.ndarray) -> np.ndarray:
    """True where noise zigzags, at the first sample of it, shape (n - 3,), n >= 4."""
    change, third = np.diff(value), np.diff(value, 3)
    step = float(np.min(np.abs(change), where=change != 0.0, initial=np.inf))
    large = np.where(np.abs(third) > _ROUNDING * step, third, 0.0) if np.isfinite(step) else np.zeros(third.size)
    return _alternates(change) | np.concatenate((_alternates(large), [False, False]))


def _alternates(change: np.ndarray) -> np.ndarray:
    """True where three in a row alternate in sign, at the first of them, shape (n - 2,); () of fewer."""
    turns = change[:-1] * change[1:] < 0.0
    return turns[:-1] & turns[1:]


def _rolling(sign: np.ndarray) -> np.ndarray:
    """sum_j s_(k+j) B^(W-1-j) modulo 2^64 of each window, shape (n - W + 1,), by doubling."""
    whole, have = np.zeros(sign.size + 1, dtype=np.uint64), 0
    part, length = (sign.astype(np.int64) + 2).astype(np.uint64), 1
    while length <= WINDOW:
        if WINDOW & length:  # append a piece of this length behind what is there
            whole = whole[: sign.size - have - length + 1] * _power(length) + part[have : sign.size - length + 1]
            have += length
        if 2 * length <= WINDOW:
            part = part[:-length] * _power(length) + part[length:]
        length *= 2
    return whole


def _power(exponent: int) -> np.uint64:
    return np.uint64(pow(int(_ODD), exponent, 1 << 64))


def _is_record(shared: Shared, evidence: int) -> bool:
    """Whether the values of every common channel agree and contain noise."""
    pieces = _common(shared)
    return all(_agree(a, b) for a, b in pieces.values()) and evidence <= sum(
        _erratic(a) for name, (a, _) in pieces.items() if name not in COMMANDED
    )


def _common(shared: Shared) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """SI values of the shared rows, by channel."""
    here, there = (slice(k, k + shared.rows) for k in (shared.first, shared.second))
    one, other = shared.one.channels, shared.other.channels
    return {name: (one[name].values(here), other[name].values(there)) for name in one if name in other}


def _agree(a: np.ndarray, b: np.ndarray) -> bool:
    there = np.isfinite(a) & np.isfinite(b)
    if there.sum() < AGREE * max(np.isfinite(a).sum(), np.isfinite(b).sum()):
        return False
    a, b = a[there], b[there]
    changes = np.abs(np.diff(b))
    moves = changes[changes > 0.0]
    tolerance = DIGITS * float(np.median(moves)) if moves.size else 0.0
    same = np.abs(a - b) <= max(tolerance, 1e-9 * float(np.max(np.abs(b), initial=0.0)))
    return bool(np.mean(same) >= AGREE) if same.size else True


def _erratic(value: np.ndarray) -> int:
    """Zigzags and lone spikes of a piece."""
    value = value[np.isfinite(value)]
    if value.size <= 5:
        return 0
    change = np.diff(value)
    still = change == 0.0  # a spike leaves a resting value for one sample: 0 + - 0 or 0 - + 0
    spikes = still[:-3] & (change[1:-2] * change[2:-1] < 0.0) & still[3:]
    return int(_zigzag(value).sum() + spikes.sum())


def _copies(shared: Shared, logs: Sequence[Log]) -> list[Log]:
    """Further logs that are whole copies of either."""
    rows = len(shared.one.lines)
    others = [log for log in logs if log not in (shared.one, shared.other) and len(log.lines) == rows]
    pairs = [Shared(shared.one, log, 0, 0, rows) for log in others if shared.whole]
    return [pair.other for pair in pairs if _is_record(pair, EVIDENCE)]


def _refusal(shared: Shared, copies: Sequence[Log]) -> MeasurementError:
    first, second = sorted((shared.one, shared.other), key=lambda log: log.file)
    rows = {id(shared.one): shared.first, id(shared.other): shared.second}
    k, j = rows[id(first)], rows[id(second)]
    if shared.whole:
        named = f"; so do {first_names([log.file for log in copies], NAMED)}" if copies else ""
        found = f"it holds the same numbers as {first.file}, row by row, including the noise{named}."
    else:
        late = float(first.time[k] - second.time[j])
        moved = "at the same times" if late == 0.0 else f"with {abs(late):.6g} s {'taken off' if late > 0 else 'added'}"
        found = (f"its lines {second.lines[j]} to {second.lines[j + shared.rows - 1]} hold the same numbers as lines "
                 f"{first.lines[k]} to {first.lines[k + shared.rows - 1]} of {first.file}, {moved}.")  # fmt: skip
    return MeasurementError(second.where, found,
                            "Each record must be there only one time: the fit takes each file as independent data, "
                            "and a copy makes intervals too narrow, or is predicted after it was fitted.",
                            "Delete one of them, or cut them where they overlap; the joint fit uses every channel of a "
                            "record, whichever folder it lies in.")  # fmt: skip


def _alike(logs: Sequence[Log]) -> list[str]:
    """Warnings on moving files that agree in every number but have no noise, or too few samples for a window."""

    def key(log: Log) -> bytes:
        return b"".join(f"{name}:{len(log.lines)}".encode() + _shape(log, name) for name in sorted(log.channels))

    warnings = []
    for _, group in groupby(sorted(logs, key=key), key=key):
        first, *others = group
        for log in others:
            shared = Shared(first, log, 0, 0, len(log.lines))
            if _is_record(shared, EVIDENCE):
                raise _refusal(shared, _copies(shared, logs))
            moves = any(np.ptp(a[np.isfinite(a)]) > 0.0 for a, _ in _common(shared).values() if np.isfinite(a).any())
            if moves and all(_agree(a, b) for a, b in _common(shared).values()):
                warnings.append(f"{log.where}: the same numbers as {first.file}, without noise, so it may be a copy or "
                                "a repeated simulation. Each counts as independent data; delete one if it is a copy."
                                )  # fmt: skip
    return warnings


def _shape(log: Log, name: str) -> bytes:
    """Digest of the rises, falls and gaps of a channel."""
    column = log.columns[name]
    with np.errstate(invalid="ignore"):
        sign = np.sign(np.diff(column.logged * np.sign(column.conversion.scale)))
    return hashlib.blake2b(np.nan_to_num(sign, nan=7.0).astype(np.int8).tobytes(), digest_size=16).digest()
