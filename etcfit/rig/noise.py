"""Estimates noise and resolution of a channel from its samples alone.

    d = sum_j w_j y_j / |w|,   w_j = 1 / prod_(k != j) (t_j - t_k)

A divided difference of order p over p + 1 neighbours removes polynomials below degree p on any time base, and scaled to
unit norm it keeps the standard deviation of white noise. Its spread is estimated by Huber's Proposal 2, on which steps
and impacts have little influence. Each higher order has all of the noise and less of a smooth signal, so the smallest
estimate is used.

Source: von Neumann 1941 (successive differences), Huber 1964 (Proposal 2). Differs from source: orders 2 to 5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from statistics import median

import numpy as np

ORDERS = (2, 3, 4, 5)
ROBUST = 1.0  # Huber's c; half of the differences may be outliers
COARSE = (
    3.0  # Huber's c where the resolution is visible: most differences are then zero, and the rare ones are the noise
)
LEVELS = 8  # number of distinct values below which one trace may show commanded levels instead of a resolution
FINE = 0.02  # share of the rig's range of the channel; with so few levels only a finer step is a resolution
MANY_LEVELS = 40  # number of levels from which on a resolution is found although decimals round the converter's steps
REVISITED = 0.4  # most levels per sample; a smooth noise-free ramp is evenly spaced too, but has each level one time
STEPS = 16  # least number of changes by one level: a quantised ramp has them, a staircase of commands has not
BLOCK = 1 << 13  # samples in a block that stays in the processor's cache, which takes a third of the time
FLOOR = 1e-6  # least noise as a share of the range, for noise-free (simulated) data


@dataclass(frozen=True)
class Texture:
    """Noise, resolution and span of one channel of one trace, SI."""

    sigma: float
    quantum: float
    span: float


def textures(time: np.ndarray, values: Sequence[np.ndarray]) -> list[Texture]:
    """The textures of several channels that were logged at the same instants, whose weights are computed together."""
    quanta = [quantum(value) for value in values]
    # the noise of each channel, for each of its values of Huber's c
    clips = [(ROBUST, COARSE) if q else (ROBUST,) for q in quanta]
    least = [[np.inf] * len(own) for own in clips]
    for order in (p for p in ORDERS if len(time) >= 2 * (p + 1)):
        for known, own, d in zip(least, clips, _divided_differences(time, values, order), strict=True):
            known[:] = [min(before, _spread(d, clip)) for before, clip in zip(known, own, strict=True)]
    fine = [tuple(s if np.isfinite(s) else 0.0 for s in known) for known in least]
    found = []
    for value, q, sigmas in zip(values, quanta, fine, strict=True):
        span = (float(np.ptp(value)) if len(value) else 0.0) or float(np.max(np.abs(value), initial=0.0)) * 1e-3
        found.append(Texture(max(sigmas) if sigmas[0] < q / 2 else sigmas[0], q, span))
    return found


def pooled(own: Sequence[Texture], of_rig: Sequence[Texture]) -> tuple[float, float]:
    """Noise and resolution of one sensor in one rig test.

    It is the median over all traces of this sensor. Where the median of this test differs by more than a factor of 2,
    the test had another range or instrument, and its own median is used. The noise is at least the rounding error
    q/sqrt(12).

    Args:
        own: traces of this test.
        of_rig: traces of all tests that log under the same header.

    Returns:
        sigma > 0 and quantum >= 0, SI.
    """
    sigma, here = (_median([t.sigma for t in group]) for group in (of_rig, own))
    if here > 0 and not 0.5 <= sigma / here <= 2.0:
        sigma = here
    span = max(t.span for t in of_rig)
    seen, seen_here = (
        [t.quantum for t in group if t.span > (LEVELS - 1.5) * t.quantum or t.quantum <= FINE * span]
        for group in (of_rig, own)
    )
    quantum = _median(seen_here) or _median(seen)
    return max(sigma, quantum / math.sqrt(12), FLOOR * span, 1e-12), quantum


def quantum(value: np.ndarray) -> float:
    """Smallest common increment of the values; 0 where they show none.

    Long levels with jumps between them are commands, not steps of a converter, and have no quantum.
    """
    levels = np.unique(value)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * max(float(np.ptp(value)), 1e-300)]
    if not 2 <= len(gaps) + 1 <= REVISITED * len(value):
        return 0.0
    starts = (np.median(gaps), *(gaps.min() / m for m in (1, 2, 3, 4)))
    q = next((q for start in starts if (q := _lattice(gaps, float(start)))), 0.0)
    return 0.0 if q and len(gaps) >= LEVELS - 1 and _is_command(value, q) else q


def _median(values: list[float]) -> float:
    seen = [v for v in values if v > 0]
    return median(seen) if seen else 0.0


def _divided_differences(time: np.ndarray, values: Sequence[np.ndarray], order: int) -> np.ndarray:
    """d of every channel, shape (channels, n - order)."""
    n = len(time) - order
    d = np.empty((len(values), n))
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        weights, length = _weights(time[start : stop + order], order)
        for row, value in zip(d, values, strict=True):
            terms = (w * value[start + j : stop + j] for j, w in enumerate(weights))
            np.divide(reduce(np.add, terms), length, out=row[start:stop])
    return d


def _weights(time: np.ndarray, order: int) -> tuple[list[np.ndarray], np.ndarray]:
    """w_j and |w|, each of shape (n - order,)."""
    n = len(time) - order
    first, whole = time[:n], time[order:] - time[:n]
    # d does not depend on the scale of time; this one keeps the products finite
    t = [(time[j : j + n] - first) / whole for j in range(order + 1)]
    w = [1 / reduce(np.multiply, [t[j] - t[k] for k in range(order + 1) if k != j]) for j in range(order + 1)]
    return w, np.sqrt(reduce(np.add, [each * each for each in w]))


def _spread(d: np.ndarray, c: float) -> float:
    """Huber's Proposal 2: s with mean(min(d^2, c^2 s^2)) = s^2 E min(z^2, c^2), z standard normal."""
    inside, density = math.erf(c / math.sqrt(2)), math.exp(-c * c / 2) / math.sqrt(2 * math.pi)
    clipped_variance = inside - 2 * c * density + c * c * (1 - inside)
    square, clipped = d * d, np.empty_like(d)
    s2 = float(np.mean(square))
    for _ in range(60):
        before, s2 = s2, float(np.mean(np.minimum(square, c * c * s2, out=clipped))) / clipped_variance
        if s2 > 0.999 * before:
            break
    return math.sqrt(s2)


def _lattice(gaps: np.ndarray, start: float) -> float:
    """q of which every gap is a multiple, to within the decimals to which the converter's steps were rounded."""
    q = start
    for _ in range(5):
        k = np.maximum(np.round(gaps / q), 1)
        q = float(np.sum(gaps * k) / np.sum(k * k))
    k = np.round(gaps / q)
    rounded = len(gaps) >= MANY_LEVELS and np.mean(k <= 3) > 0.5
    return q if np.max(np.abs(gaps - k * q)) <= (0.35 if rounded else 0.05) * q else 0.0


def _is_command(value: np.ndarray, q: float) -> bool:
    """Whether a channel has held levels with single jumps, larger than one level or too few for a quantised ramp."""
    jumps = np.abs(np.diff(value))
    moves = jumps > 0.5 * q
    alone = moves & ~np.roll(moves, 1) & ~np.roll(moves, -1)
    if np.sum(alone) < 0.7 * np.sum(moves):
        return False
    return bool(np.median(jumps[moves]) > 1.5 * q or np.sum(jumps[moves] < 1.5 * q) < STEPS)
