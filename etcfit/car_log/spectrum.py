"""The frequencies at which the plate is moved: spectrum of a logged position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .log import Series

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
