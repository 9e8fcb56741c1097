"""One record under two names: copies, cuts and overlaps are found and refused.

    s_k = sign(y_(k+3) - 3 y_(k+2) + 3 y_(k+1) - y_k)

A measurement never repeats another one's noise. The signs of a channel's third differences stay what they are in
another unit, under another name, with other comments and shifted in time. Where W of them in a row, zigzags of noise
among them, stand in two files, and the values of every common channel agree as far as the files overlap, the two are
one record.

A zigzag is three changes of alternating direction, which a smooth signal never shows, however coarsely it is rounded,
for rounding keeps a rise from becoming a fall; or three third differences of alternating sign, each larger than
rounding alone could make it, 4 steps. So plates at rest, constant voltages and noiseless simulations, which repeat
each other by right, are left alone; noiseless files that agree in every number are named in a warning.

Records that share a piece end to end are found: the later one's head lies within the earlier one. One thinned to every
second row is not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from ..errors import MeasurementError
from .columns import Log

COMMANDED = ("setpoint", "duty", "supply")  # what a rig plays it plays twice alike: no noise of a record's own
_ROUNDING = 5.0  # steps; a third difference of rounding errors, half a step each at most, is within 4
_ODD = np.uint64(0x9E3779B97F4A7C15)  # odd, hence invertible modulo 2^64: the base of the rolling hash


@dataclass(frozen=True)
class DuplicateSettings:
    """When two files hold one record.

    Args:
        window: third differences in a row whose signs a first look compares, W.
        zigzags: of noise within such a window, at least.
        glance: rows at the head of what two files may share that are compared before the rest.
        evidence: zigzags and lone spikes in all that the two files share, at least.
        agree: share of the common rows whose values must be the same; the rest is for digits lost in writing.
        digits: of the median change from row to row, by which the same value may differ.
        named: copies that a message names.
    """

    window: int = 32
    zigzags: int = 8
    glance: int = 128
    evidence: int = 10
    agree: float = 0.98
    digits: float = 0.02
    named: int = 5


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


def refuse_duplicates(logs: Sequence[Log], settings: DuplicateSettings = DuplicateSettings()) -> list[str]:
    """Refuse records that lie in a folder twice, whole or in part.

    Args:
        logs: every trace of the folder.
        settings: what counts as the same.

    Returns:
        a warning for each file that repeats another one number for number, but without noise that would tell a copy
        from a simulation made twice.

    Raises:
        MeasurementError: naming both files, or the first few where one was copied often.
    """
    for at in _seen_twice(logs, settings):
        shared = _overlap(*at)
        glance = replace(shared, rows=min(shared.rows, settings.glance))
        if _is_record(glance, settings, 0) and _is_record(shared, settings, settings.evidence):
            raise _refusal(shared, _copies(shared, logs, settings))
    return _alike(logs, settings)


def _seen_twice(logs: Sequence[Log], settings: DuplicateSettings) -> Iterator[tuple[Log, Log, int, int]]:
    """Every log's first window of noise, wherever it stands in another log: the two logs, and a row of each."""
    names = dict.fromkeys(name for log in logs for name in log.channels if name not in COMMANDED)
    for name in names:
        prints = [_fingerprint(log, name, settings) for log in logs if name in log.channels]
        heads = {each.hashes[each.head]: each for each in prints if each.head is not None}
        sought = np.sort(np.array(list(heads), dtype=np.uint64))
        for each in prints if sought.size else ():
            near = sought[np.minimum(np.searchsorted(sought, each.hashes), sought.size - 1)]
            for k in np.flatnonzero(near == each.hashes):
                yield from _pairs(each, int(k), [p for p in prints if p.begins(each.hashes[k])])


@dataclass(frozen=True, eq=False)
class _Fingerprint:
    """Hash of each window of one channel.

    Args:
        rows: where its samples stand in the log, shape (n,).
        hashes: shape (n - 2 - W,); empty where the channel is shorter.
        head: the first window with enough noise in it, or None.
    """

    log: Log
    rows: np.ndarray
    hashes: np.ndarray
    head: int | None

    def begins(self, value: np.uint64) -> bool:
        return self.head is not None and self.hashes[self.head] == value


def _pairs(found: _Fingerprint, k: int, heads: Sequence[_Fingerprint]) -> Iterator[tuple[Log, Log, int, int]]:
    for each in heads:
        if each.log is not found.log and each.head is not None:
            yield found.log, each.log, int(found.rows[k]), int(each.rows[each.head])


def _fingerprint(log: Log, name: str, settings: DuplicateSettings) -> _Fingerprint:
    value = log.columns[name].logged * np.sign(log.columns[name].conversion.scale)
    rows = np.flatnonzero(np.isfinite(value))
    value = value[rows]
    if value.size < settings.window + 3:
        return _Fingerprint(log, rows, np.empty(0, np.uint64), None)
    noisy = _within(_zigzag(value), settings.window) >= settings.zigzags
    head = int(np.argmax(noisy)) if noisy.any() else None
    return _Fingerprint(log, rows, _rolling(_signs(np.diff(value, 3), value), settings.window), head)


def _signs(difference: np.ndarray, value: np.ndarray) -> np.ndarray:
    """-1, 0, 1; 0 also where only the conversion of units keeps two equal numbers apart."""
    exact = 1e-9 * float(np.max(np.abs(value), initial=0.0))
    return (difference > exact).astype(np.int8) - (difference < -exact).astype(np.int8)


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


def _spike(value: np.ndarray) -> np.ndarray:
    """True where a resting value is left for one sample, shape (n - 4,): 0 + - 0 or 0 - + 0."""
    change = np.diff(value)
    still = change == 0.0
    return still[:-3] & (change[1:-2] * change[2:-1] < 0.0) & still[3:]


def _within(flags: np.ndarray, window: int) -> np.ndarray:
    """How many zigzags begin in each window of third differences, shape (n - window + 1,)."""
    sums = np.concatenate(([0], np.cumsum(flags)))
    return sums[window:] - sums[:-window]


def _rolling(sign: np.ndarray, window: int) -> np.ndarray:
    """sum_j s_(k+j) B^(W-1-j) modulo 2^64 of each window, shape (n - W + 1,), by doubling."""
    whole, have = np.zeros(sign.size + 1, dtype=np.uint64), 0
    part, length = (sign.astype(np.int64) + 2).astype(np.uint64), 1
    while length <= window:
        if window & length:  # append a piece of this length behind what is there
            whole = whole[: sign.size - have - length + 1] * _power(length) + part[have : sign.size - length + 1]
            have += length
        if 2 * length <= window:
            part = part[:-length] * _power(length) + part[length:]
        length *= 2
    return whole


def _power(exponent: int) -> np.uint64:
    return np.uint64(pow(int(_ODD), exponent, 1 << 64))


def _overlap(one: Log, other: Log, row: int, same: int) -> Shared:
    """All rows that the two logs have in common, if one row of each is the same instant."""
    before = min(row, same)
    rows = before + min(len(one.lines) - row, len(other.lines) - same)
    return Shared(one, other, row - before, same - before, rows)


def _is_record(shared: Shared, settings: DuplicateSettings, evidence: int) -> bool:
    """The values of every common channel agree, and there is noise in them."""
    pieces = _common(shared)
    return all(_agree(a, b, settings) for a, b in pieces.values()) and evidence <= sum(
        _erratic(a) for name, (a, _) in pieces.items() if name not in COMMANDED
    )


def _common(shared: Shared) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """SI values of the shared rows, by channel."""
    here, there = (slice(k, k + shared.rows) for k in (shared.first, shared.second))
    one, other = shared.one.channels, shared.other.channels
    return {name: (one[name].values(here), other[name].values(there)) for name in one if name in other}


def _agree(a: np.ndarray, b: np.ndarray, settings: DuplicateSettings) -> bool:
    there = np.isfinite(a) & np.isfinite(b)
    if there.sum() < settings.agree * max(np.isfinite(a).sum(), np.isfinite(b).sum()):
        return False
    a, b = a[there], b[there]
    changes = np.abs(np.diff(b))
    moves = changes[changes > 0.0]
    tolerance = settings.digits * float(np.median(moves)) if moves.size else 0.0
    same = np.abs(a - b) <= max(tolerance, 1e-9 * float(np.max(np.abs(b), initial=0.0)))
    return bool(np.mean(same) >= settings.agree) if same.size else True


def _erratic(value: np.ndarray) -> int:
    """Zigzags and lone spikes of a piece."""
    value = value[np.isfinite(value)]
    return int(_zigzag(value).sum() + _spike(value).sum()) if value.size > 5 else 0


def _copies(shared: Shared, logs: Sequence[Log], settings: DuplicateSettings) -> list[Log]:
    """Further logs that are whole copies of either."""
    rows = len(shared.one.lines)
    others = [log for log in logs if log not in (shared.one, shared.other) and len(log.lines) == rows]
    pairs = [Shared(shared.one, log, 0, 0, rows) for log in others if shared.whole]
    return [pair.other for pair in pairs if _is_record(pair, settings, settings.evidence)]


def _refusal(shared: Shared, copies: Sequence[Log]) -> MeasurementError:
    first, second = sorted((shared.one, shared.other), key=lambda log: log.file)
    where, k, j = second.where, *_rows_of(shared, first, second)
    if shared.whole:
        found = f"it holds the same numbers as {first.file}, row by row, noise and all{_named(copies)}."
    else:
        late = float(first.time[k] - second.time[j])
        moved = "at the same times" if late == 0.0 else f"with {abs(late):.6g} s {'taken off' if late > 0 else 'added'}"
        found = (f"its lines {second.lines[j]} to {second.lines[j + shared.rows - 1]} hold the same numbers as lines "
                 f"{first.lines[k]} to {first.lines[k + shared.rows - 1]} of {first.file}, {moved}.")  # fmt: skip
    return MeasurementError(where, found,
                            "Every record counts once: the fit takes each file as new noise, and one that lies there "
                            "twice makes intervals too narrow, or is predicted after it was fitted.",
                            "Delete one of them, or cut them where they overlap; the joint fit uses every channel of a "
                            "record, whichever folder it lies in.")  # fmt: skip


def _rows_of(shared: Shared, first: Log, second: Log) -> tuple[int, int]:
    rows = {id(shared.one): shared.first, id(shared.other): shared.second}
    return rows[id(first)], rows[id(second)]


def _named(copies: Sequence[Log], most: int = DuplicateSettings().named) -> str:
    if not copies:
        return ""
    more = f" and {len(copies) - most} more" if len(copies) > most else ""
    return f"; so do {', '.join(log.file for log in copies[:most])}{more}"


def _alike(logs: Sequence[Log], settings: DuplicateSettings) -> list[str]:
    """Files that agree in every number, and move, but have no noise; or, with noise, were too rough for a window."""

    def key(log: Log) -> bytes:
        return b"".join(f"{name}:{len(log.lines)}".encode() + _shape(log, name) for name in sorted(log.channels))

    warnings = []
    for _, group in groupby(sorted(logs, key=key), key=key):
        first, *others = group
        for log in others:
            shared = Shared(first, log, 0, 0, len(log.lines))
            if _is_record(shared, settings, settings.evidence):
                raise _refusal(shared, _copies(shared, logs, settings))
            moves = any(np.ptp(a[np.isfinite(a)]) > 0.0 for a, _ in _common(shared).values() if np.isfinite(a).any())
            if moves and all(_agree(a, b, settings) for a, b in _common(shared).values()):
                warnings.append(f"{log.where}: the same numbers as {first.file}, and no noise in them that would tell "
                                "a copy from a simulation made twice. Each counts as data of its own; delete one if "
                                "it is a copy.")  # fmt: skip
    return warnings


def _shape(log: Log, name: str) -> bytes:
    """Rises and falls of a channel, gaps included, in a digest's length."""
    column = log.columns[name]
    with np.errstate(invalid="ignore"):
        sign = np.sign(np.diff(column.logged * np.sign(column.conversion.scale)))
    return hashlib.blake2b(np.nan_to_num(sign, nan=7.0).astype(np.int8).tobytes(), digest_size=16).digest()
