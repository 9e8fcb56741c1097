"""Finds the steps of a setpoint in a log, and evaluates the response to each: overshoot, settling, lag, error.

A step is a change within 0.1 s between two rests of 0.3 s at least. Other files of this room use its functions too:
`rests`, where a signal stands still; `noise_sd` and `log_resolution`, noise and resolution of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .criteria import LEAST_HELD, LEAST_OVERSHOT, NEGLIGIBLE, SETTLED, TAIL
from .log import Series

_GRID = 0.01  # s
_STILL = 0.2  # per cent of travel within which a setpoint rests
_JITTER = 8.0, 1.0  # allowed motion of a noisy setpoint at rest: standard deviations of it, and per cent at most
_REST = 0.3  # s that a rest lasts at least
_QUICK = 0.1  # s that a step takes at most
_SEEN = 4.0  # standard deviations of the noise: least visible overshoot, and band of a settled plate
_RISE = 0.8, 0.2  # shares of the way left between which the rise is timed
_ROUND = 0.75  # of the rise, either side of the top: there a second-order response is a parabola to 0.1 %
_LEVELS = 8  # least number of different values that show the resolution of a position
_LEAST = 0.5  # per cent: a smaller step is not judged
_FEWEST = 5  # samples of the position that a step needs


@dataclass(frozen=True)
class Rest:
    """A stretch in which a setpoint stands still."""

    # begin, end: s
    begin: float
    end: float
    # first, last: value at both, the median of 0.3 s, per cent
    first: float
    last: float


@dataclass(frozen=True)
class Step:
    """A step of the setpoint, and the response of the plate."""

    begin: float  # when the setpoint changes, s
    # before, after: setpoint, per cent of travel
    before: float
    after: float
    held: float  # how long the setpoint then rests, s
    # largest excess beyond the new level, per cent of the step (of 1 % of the travel where that is more)
    overshoot: float
    settling: float  # s until the error stays within `band`; infinite where it does not do so within `held`
    lag: float | None  # s until the plate has moved half of its way; None where it does not
    error: float  # mean of position - setpoint in the last quarter of the rest, per cent of travel
    rms: float  # of the error over the whole rest, per cent of travel
    # error within which the plate counts as settled, per cent of travel: 2 % of the step, 0.2 % of the travel, or 4
    # standard deviations of the sensor's noise, whichever is largest
    band: float

    @property
    def size(self) -> float:
        """Change of the setpoint, per cent of travel, with its sign."""
        return self.after - self.before

    @property
    def error_pct(self) -> float:
        """|error| as a share of the step, or of 40 % of the travel where that is more, per cent."""
        return 100.0 * abs(self.error) / max(abs(self.size), 100.0 * LEAST_HELD)


def rests(piece: Series) -> list[Rest]:
    """The rests of a setpoint without a gap, 0.3 s long at least: it stays within 0.2 %, or, where it is noisy, within
    eight standard deviations of its noise, 1 % at most."""
    time = np.arange(piece.time[0], piece.time[-1], _GRID)
    value = np.interp(time, piece.time, piece.value)
    if not time.size:
        return []
    still = rest_tolerance(piece)
    spans, begin, least, most = list[tuple[int, int]](), 0, value[0], value[0]
    for k, here in enumerate((*value.tolist(), np.inf)):  # the end ends a rest too
        least, most = min(least, here), max(most, here)
        if most - least <= still:
            continue
        if (k - begin) * _GRID >= _REST:
            spans.append((begin, k))
        begin, least, most = k, here, here
    few = round(_REST / _GRID)
    return [Rest(float(time[a]), float(time[b - 1]), float(np.median(value[a : a + few])),
                 float(np.median(value[b - few : b]))) for a, b in spans]  # fmt: skip


def rest_tolerance(setpoint: Series) -> float:
    """How far a setpoint may move at rest, per cent of travel."""
    return float(np.clip(_JITTER[0] * noise_sd(setpoint.value), _STILL, _JITTER[1]))


def pairs_with_quick_change(found: Sequence[Rest]) -> list[tuple[Rest, Rest]]:
    """Pairs of neighbouring rests between which the setpoint changes quickly."""
    return [(a, b) for a, b in pairwise(found) if b.begin - a.end - _GRID <= _QUICK + 1e-9]


def noise_sd(value: np.ndarray) -> float:
    """Standard deviation of a sensor's noise, from the median of second differences, or from its resolution.

        median |y_k+1 - 2 y_k + y_k-1| / (0.6745 sqrt 6)

    A plate that moves smoothly has second differences near 0; at most half of the samples may be others. Where most are
    exactly 0, q/sqrt 12 of the resolution q remains.
    """
    if value.size < 4:
        return 0.0
    sd = float(np.median(np.abs(np.diff(value, 2))) / (0.6745 * np.sqrt(6.0)))
    return max(sd, log_resolution(value) / np.sqrt(12.0))


def log_resolution(value: np.ndarray) -> float:
    """Resolution of a log: the least difference of two values, where many values repeat; otherwise 0."""
    levels = np.unique(np.round(value, 6))
    if levels.size < _LEVELS or levels.size > 0.5 * value.size:
        return 0.0
    gaps = np.diff(levels)
    return float(np.median(gaps[gaps <= 1.5 * gaps.min()]))


def steps(position: Series, setpoint: Series) -> tuple[Step, ...]:
    """Every step that the log holds, in the order of time.

    Source: the paper, section 4.1. Differs from source: `band`; and the steady-state error is the mean of the tail, not
    its largest value, which noise makes larger.
    """
    sd = noise_sd(position.value)
    found = []
    for piece in setpoint.pieces:
        if piece.time.size > 1:
            still = rest_tolerance(piece)  # computed per piece: a long log has thousands of steps
            found += [_step(position, setpoint, a, b, sd, still) for a, b in pairs_with_quick_change(rests(piece))]
    return tuple(each for each in found if each is not None)


def _begin(setpoint: Series, before: Rest, after: Rest, still: float) -> float:
    """When the setpoint begins to change: half a sample after the last one that is still at rest, s."""
    k = int(np.searchsorted(setpoint.time, before.end - 2.0 * _GRID))
    while k + 1 < setpoint.time.size and setpoint.time[k + 1] <= after.begin + _GRID:
        if abs(setpoint.value[k + 1] - before.last) > still:
            break
        k += 1
    following = setpoint.time[min(k + 1, setpoint.time.size - 1)]
    return float(setpoint.time[k] + 0.5 * min(following - setpoint.time[k], 2.0 * _GRID))


def _step(position: Series, setpoint: Series, before: Rest, after: Rest, sd: float, still: float) -> Step | None:
    size, begin, end = after.first - before.last, _begin(setpoint, before, after, still), after.end
    seen = (position.time >= begin) & (position.time <= end)
    if abs(size) < max(_LEAST, 2.0 * sd) or seen.sum() < _FEWEST or before.end > position.time[-1]:
        return None
    time, value = position.time[seen] - begin, position.value[seen]
    beyond = (value - after.first) * np.sign(size)
    band = max(SETTLED * abs(size), 100.0 * NEGLIGIBLE, _SEEN * sd)
    tail = time >= (1.0 - TAIL) * (end - begin)
    start = (float(np.interp(begin, position.time, position.value)) - after.first) * float(np.sign(size))
    most, noise = _top(time, beyond, start)
    return Step(
        begin, before.last, after.first, end - begin,
        100.0 * most / max(abs(size), 100.0 * LEAST_OVERSHOT) if most > max(_SEEN * noise * sd, 1e-9) else 0.0,
        _settling(time, beyond, band), _reached(start, time, beyond, 0.5),
        float(np.mean((value - after.first)[tail])) if tail.any() else float(value[-1] - after.first),
        float(np.sqrt(np.mean(beyond**2))), band,
    )  # fmt: skip


def _top(time: np.ndarray, beyond: np.ndarray, start: float) -> tuple[float, float]:
    """The top of the overshoot, and its noise over that of a sample.

    The top is that of a least-squares parabola about the highest moving mean. Its width, in which a second-order
    response is close to a parabola, follows from the rise from 20 to 80 %. The highest sample alone would include the
    highest noise in a fast log, and miss the top in a slow one with three samples there.
    """
    early, late = (_reached(start, time, beyond, left) for left in _RISE)
    rise = 0.0 if early is None or late is None else late - early
    n = max(int(_ROUND * rise / float(np.median(np.diff(time)))), 1)
    if beyond.size < 2 * n + 1:
        return float(beyond.max()), 1.0
    k = n + int(np.argmax(np.convolve(beyond, np.full(2 * n + 1, 1.0 / (2 * n + 1)), "valid")))
    about = slice(k - n, k + n + 1)
    bend, slope, level = np.polyfit(time[about] - time[k], beyond[about], 2)
    inside = bend < 0.0 and abs(slope) <= -2.0 * bend * (time[k + n] - time[k])
    top = level - slope**2 / (4.0 * bend) if inside else level
    return float(top), float(min(1.5 / np.sqrt(2 * n + 1), 1.0))


def _settling(time: np.ndarray, beyond: np.ndarray, band: float) -> float:
    """The last instant outside the band, between two samples on a straight line; infinite where the last is outside."""
    outside = np.flatnonzero(np.abs(beyond) > band)
    if not outside.size:
        return 0.0
    k = int(outside[-1])
    if k == time.size - 1:
        return np.inf
    far, near = abs(beyond[k]), np.sign(beyond[k]) * beyond[k + 1]
    return float(time[k] + (far - band) / max(far - near, 1e-12) * (time[k + 1] - time[k]))


def _reached(start: float, time: np.ndarray, beyond: np.ndarray, left: float) -> float | None:
    """The time at which a share `left` of the way from `start` remains, s; `start` and `beyond` are below 0 before the
    new level."""
    reached = np.flatnonzero(beyond >= left * start)
    if start >= 0.0 or not reached.size:
        return None
    k = int(reached[0])
    t0, b0 = (0.0, start) if k == 0 else (time[k - 1], beyond[k - 1])
    return float(t0 + (left * start - b0) / max(beyond[k] - b0, 1e-12) * (time[k] - t0))
