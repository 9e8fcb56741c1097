"""At which positions the plate spends its time, a histogram; at which frequencies it is moved, a spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .log import Series

SHARE = 0.77  # share of the time that the paper finds between 5 and 45 %
BOUNDS = 5.0, 45.0  # per cent: the positions of that share
_BIN = 5.0  # per cent, as in Fig. 6 (a)


@dataclass(frozen=True, eq=False)
class Usage:
    """Operating range, Fig. 6 (a)."""

    edges: np.ndarray  # of the bins, per cent of travel, shape (n + 1,)
    shares: np.ndarray  # of the time in each bin, shape (n,), sums to 1
    bounds: tuple[float, float]  # two positions, per cent
    between: float  # share of the time between them
    shortest: tuple[float, float]  # the shortest interval that holds 77 % of the time, per cent


def usage(position: Series, bounds: tuple[float, float] = BOUNDS) -> Usage:
    """The histogram of a position over time, each sample weighed by its duration.

    Args:
        position: per cent.
        bounds: two positions between which the share of time is given, per cent.
    """
    value, weight = position.value, position.weight / position.weight.sum()
    low, high = (_BIN * np.floor(value.min() / _BIN), _BIN * (np.floor(value.max() / _BIN) + 1.0))
    edges = np.arange(min(0.0, low), max(100.0, high) + 0.5 * _BIN, _BIN)
    shares, _ = np.histogram(value, edges, weights=weight)
    inside = (value >= bounds[0]) & (value <= bounds[1])
    return Usage(edges, shares, bounds, float(weight[inside].sum()), shortest(value, weight, SHARE))


def shortest(value: np.ndarray, weight: np.ndarray, share: float) -> tuple[float, float]:
    """The shortest interval that holds a share of the weight; an interval upwards from each value is tried.

    Args:
        value: shape (n,).
        weight: shape (n,), sums to 1.
        share: 0 to 1.
    """
    order = np.argsort(value, kind="stable")
    rising, below = value[order], np.concatenate(([0.0], np.cumsum(weight[order])))
    last = np.searchsorted(below[1:], below[:-1] + share - 1e-12)
    fits = last < rising.size
    length = rising[last[fits]] - rising[fits]
    k = int(np.argmin(length))
    return float(rising[fits][k]), float(rising[last[fits][k]])


_SEGMENT = 10.0  # s: resolves 1.0 and 1.1 Hz
_SLOWEST = 0.25  # Hz: slower motion comes from the track, not from the foot
_MOST = 20.0  # Hz that are of interest


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectrum of the position, Fig. 6 (b)."""

    frequency: np.ndarray  # Hz, shape (n,)
    amplitude: np.ndarray  # per cent rms in a band of one bin, shape (n,)
    dominant: float  # of the highest peak at or above 0.25 Hz, Hz; NaN where the power only falls from there on
    half: float  # below which half of the motion's power above 0.25 Hz lies, Hz


def spectrum(position: Series) -> Spectrum | None:
    """Welch's periodogram, Hann windows of 10 s that overlap by half; None for a log shorter than four seconds, or with
    too few samples a second for the frequencies shown.

    No window spans a gap of the log, because the log would be interpolated there.

    Source: Welch 1967. Differs from source: the peak is read off a parabola through its three highest points, in log.
    """
    step = position.step
    evens = [
        np.interp(np.arange(piece.time[0], piece.time[-1], step), piece.time, piece.value)
        for piece in position.pieces
        if piece.time.size > 1
    ]
    samples = min(max(even.size for even in evens), round(_SEGMENT / step))
    if samples * step < 1.0 / _SLOWEST:
        return None
    frequency, power = _over_pieces([even for even in evens if even.size >= samples], samples, step)
    felt = (frequency >= _SLOWEST) & (frequency <= _MOST)
    if not felt.any():
        return None
    dominant = _peak(frequency, np.where(frequency <= _MOST, power, 0.0))
    frequency, power = frequency[felt], power[felt]
    grown = np.cumsum(power)
    half = float(np.interp(0.5 * grown[-1], grown, frequency))
    return Spectrum(frequency, np.sqrt(power), dominant, half)


def _over_pieces(evens: Sequence[np.ndarray], samples: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequency and power, a piece weighing by its length."""
    from scipy.signal import welch

    found = [welch(even, fs=1.0 / step, nperseg=samples, detrend="linear", scaling="spectrum") for even in evens]
    powers = np.array([power for _, power in found])
    return found[0][0], np.average(powers, axis=0, weights=[even.size for even in evens])


def _peak(frequency: np.ndarray, power: np.ndarray) -> float:
    """The highest bin at or above 0.25 Hz that exceeds both neighbours; neighbours below
    0.25 Hz count too."""
    inner = np.arange(1, power.size - 1)
    tops = inner[
        (power[inner] > power[inner - 1]) & (power[inner] >= power[inner + 1]) & (frequency[inner] >= _SLOWEST)
    ]
    if not tops.size:
        return float("nan")
    k = int(tops[np.argmax(power[tops])])
    if not np.all(power[k - 1 : k + 2] > 0.0):
        return float(frequency[k])
    left, top, right = np.log(power[k - 1 : k + 2])
    shift = 0.5 * (left - right) / (left - 2.0 * top + right)
    return float(frequency[k] + shift * (frequency[1] - frequency[0]))
