"""A sine of unknown frequency in a channel, against whatever else moves there.

    F = (K - 1) |mu|^2 sum_k U_k^2 / sum_k |y_k - mu U_k|^2,   mu = sum_k U_k y_k / sum_k U_k^2
    P(> F) = (1 + F/(K - 1))^(1 - K)

y_k is the Fourier transform of the trace under the k-th of K sine tapers, U_k the taper's own sum. A line has the same
phase and size under all tapers; a motion that has power there too has not. Before, the trace is differenced twice (slow
motion goes), and what exceeds its noise is cut (steps and impacts go).

Source: Thomson 1982, harmonic F-test; Riedel and Sidorenko 1995, sine tapers. Differs from source: differences first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base import Channel
from ..signals import MAD_TO_SIGMA

CUT = 5.0  # noises beyond which a second difference is no noise
MOST = 9  # tapers
FEWEST = 4
UNEVEN = 0.2  # rms of the intervals over their median; beyond it a Fourier transform sees no clock
LONGEST = 1 << 15  # samples looked at


class Line(NamedTuple):
    """A sine in one channel.

    Args:
        frequency: Hz, by the log's own clock.
        error: of the frequency, Hz.
        amplitude: SI.
        chance: probability that noise would show one as clear within the band that was searched.
    """

    frequency: float
    error: float
    amplitude: float
    chance: float


def line_near(channel: Channel, frequency: float, band: float) -> Line | None:
    """The clearest line within `frequency` (1 +- band), Hz; None where the trace is too short, slow or uneven."""
    time, value = channel.time[:LONGEST], channel.value[:LONGEST]
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    if value.size < 64 or np.sqrt(np.mean((steps / step - 1.0) ** 2)) > UNEVEN or 2.5 * frequency * step > 1.0:
        return None
    duration = float(time[-1] - time[0])
    tapers = min(MOST, int(0.6 * frequency * duration) - 1)  # (K + 1)/(2 T) stays well below the frequency
    if tapers < FEWEST:
        return None
    even = np.interp(np.arange(time[0], time[-1], step), time, value)
    return _clearest(_bare(even), step, frequency, band, tapers)


def _bare(value: np.ndarray) -> np.ndarray:
    """Second differences without what exceeds their noise."""
    second = np.diff(value, 2)
    second = second - np.median(second)
    spread = CUT * MAD_TO_SIGMA * float(np.median(np.abs(second)))
    return np.clip(second, -spread, spread) if spread > 0.0 else second


def _clearest(x: np.ndarray, step: float, frequency: float, band: float, tapers: int) -> Line | None:
    n, size = x.size, 1 << int(np.ceil(np.log2(4 * x.size)))
    grid = np.fft.rfftfreq(size, step)
    inside = np.flatnonzero(np.abs(grid - frequency) <= band * frequency)
    index = np.arange(1, n + 1)
    windows = [np.sqrt(2.0 / (n + 1)) * np.sin(np.pi * k * index / (n + 1)) for k in range(1, tapers + 1)]
    sums = np.array([w.sum() for w in windows])
    y = np.array([np.fft.rfft(w * x, size)[inside] for w in windows])
    mu = sums @ y / np.sum(sums**2)
    left = np.sum(np.abs(y - sums[:, None] * mu) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.nan_to_num((tapers - 1) * np.abs(mu) ** 2 * np.sum(sums**2) / left, nan=0.0, posinf=1e12)
    k = int(np.argmax(f))
    at = float(grid[inside[k]])
    duration = n * step
    tried = 1.0 + 2.0 * band * frequency * duration
    alone = (1.0 + float(f[k]) / (tapers - 1)) ** (1 - tapers)
    gain = abs(2.0 * np.sin(np.pi * at * step)) ** 2  # of two differences
    error = np.sqrt(6.0 / max(float(f[k]), 1e-9)) / (np.pi * duration)
    return Line(at, float(error), 2.0 * float(abs(mu[k])) / gain, float(min(1.0, tried * alone)))
