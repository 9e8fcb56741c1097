"""Shapes of signals for guesses: smooth slopes, correlations, falls, ramps, steps."""

from __future__ import annotations

import numpy as np

FOLLOWS, SURELY_FOLLOWS = 0.6, 0.7  # correlation, or share of the variance, above which a signal follows another


def filled(values: np.ndarray) -> np.ndarray:
    """Values with gaps bridged by straight lines, shape (n,); zeros if nothing was logged."""
    there = np.isfinite(values)
    if there.all():
        return values
    rows = np.arange(values.size)
    return np.interp(rows, rows[there], values[there]) if there.any() else np.zeros(values.size)


def smooth(values: np.ndarray, samples: int) -> np.ndarray:
    """Mean over this number of samples about each, fewer at the ends, shape (n,)."""
    samples = max(1, min(samples, values.size))
    first = np.arange(values.size) - samples // 2
    begin, end = np.clip(first, 0, values.size), np.clip(first + samples, 0, values.size)
    sums = np.concatenate(([0.0], np.cumsum(values)))  # as fast for a wide window as for a narrow one
    return (sums[end] - sums[begin]) / (end - begin)


def slope(values: np.ndarray, time: np.ndarray, part: float = 0.01) -> np.ndarray:
    """Rate of change, smoothed over this share of the record, shape (n,)."""
    samples = max(3, int(part * values.size))
    return smooth(np.gradient(smooth(values, samples), time), samples)


def comes_to_rest(speed: np.ndarray) -> bool:
    """Whether the speed at the end is below half of its maximum."""
    size, end = np.abs(speed), max(3, speed.size // 20)
    return bool(np.median(size[-end:]) < 0.5 * np.quantile(size, 0.98))


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's correlation; 0 if either is constant."""
    return along(a - np.mean(a), b - np.mean(b))


def along(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation about zero instead of the means: 1 if both always have the same sign and proportion."""
    size = float(np.sqrt(np.sum(a**2)) * np.sqrt(np.sum(b**2)))
    return float(np.sum(a * b)) / size if size > 0.0 else 0.0


def span(values: np.ndarray) -> float:
    """Range between the 0.5 and 99.5 % quantiles, without single spikes."""
    low, high = np.quantile(values, [0.005, 0.995])
    return float(high - low)


def noise(values: np.ndarray) -> float:
    """Standard deviation of the changes from sample to sample; coarse steps of a converter count too."""
    # the 68 % quantile, because the median of a coarse converter's steps is 0
    return float(np.quantile(np.abs(np.diff(values)), 0.683) / np.sqrt(2.0)) if values.size > 1 else 0.0


def explained(y: np.ndarray, *columns: np.ndarray) -> float:
    """Share of the variance of y that a linear combination of the columns explains, 0 to 1."""
    design = np.column_stack([*columns, np.ones(y.size)])
    scale = np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-300)
    left = y - design @ (np.linalg.lstsq(design / scale, y, rcond=None)[0] / scale)
    total = float(np.sum((y - np.mean(y)) ** 2))
    return 1.0 - float(np.sum(left**2)) / total if total > 0.0 else 0.0


def falls(values: np.ndarray) -> list[tuple[int, int]]:
    """Each transition from above 70 % of the range to below 30 %: last row above, first row below."""
    level = smooth(values, 5)
    bottom, top = np.quantile(level, [0.01, 0.99])
    share = (level - bottom) / max(top - bottom, 1e-300)
    side = np.where(share > 0.7, 1, np.where(share < 0.3, -1, 0))
    marked = np.flatnonzero(side)
    turns = np.flatnonzero(np.diff(side[marked]) == -2)
    return [(int(marked[k]), int(marked[k + 1])) for k in turns]


def is_ramp(time: np.ndarray, values: np.ndarray, slowest: float) -> bool:
    """Whether values rise once and fall once, each in at least `slowest` s, without a jump above 10 % of the range."""
    level = smooth(values, max(3, int(0.02 * values.size)))
    size = float(np.ptp(level))
    if size <= 8.0 * noise(values) / np.sqrt(max(3, int(0.02 * values.size))):
        return False
    wandered = float(np.sum(np.abs(np.diff(level[:: max(1, level.size // 200)]))))
    if not 1.6 * size < wandered < 2.5 * size:
        return False
    top = level > np.min(level) + 0.9 * size
    bottom = level < np.min(level) + 0.1 * size
    first, last = int(np.argmax(top)), level.size - 1 - int(np.argmax(top[::-1]))
    before, after = np.flatnonzero(bottom[:first]), np.flatnonzero(bottom[last:])
    if not before.size or not after.size:
        return False
    up, down = time[first] - time[before[-1]], time[last + after[0]] - time[last]
    steepest = float(np.max(np.abs(np.diff(smooth(values, 3))))) - 6.0 * noise(values)
    return min(up, down) >= slowest and steepest < 0.1 * size


def one_frequency(time: np.ndarray, values: np.ndarray) -> bool:
    """Whether one line of the spectrum, with its neighbours, has 90 % of the power."""
    even = np.interp(np.linspace(time[0], time[-1], time.size), time, values)
    power = np.abs(np.fft.rfft((even - np.mean(even)) * np.hanning(even.size))) ** 2
    power[0] = 0.0
    peak = int(np.argmax(power))
    return float(np.sum(power[max(0, peak - 2) : peak + 3])) > 0.9 * float(np.sum(power)) > 0.0


def steps_followed(time: np.ndarray, drive: np.ndarray, response: np.ndarray) -> int:
    """Samples that the response takes for 63 % of its change after the drive's largest jump; 0 without a jump."""
    jumps = np.abs(np.diff(drive))
    k = int(np.argmax(jumps))
    if jumps[k] < max(0.3 * span(drive), 8.0 * noise(drive)) or k < 2 or k > drive.size - 6:
        return 0
    first = float(np.mean(response[max(0, k - 20) : k]))
    last = float(np.median(response[k + 1 + (drive.size - k) // 2 :]))
    if abs(last - first) < 6.0 * noise(response):
        return 0
    way = (response[k:] - first) / (last - first)
    return int(np.argmax(way > 0.63)) if (way > 0.63).any() else 0
