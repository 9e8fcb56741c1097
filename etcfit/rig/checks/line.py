"""Finds a sine of unknown frequency in a channel against the other motion there (harmonic F-test).

    F = (K - 1) |mu|^2 sum_k U_k^2 / sum_k |y_k - mu U_k|^2,   mu = sum_k U_k y_k / sum_k U_k^2
    P(> F) = (1 + F/(K - 1))^(1 - K)

y_k is the Fourier transform of the trace under the k-th of K sine tapers, U_k the sum of the taper. A line has the same
phase and size under all tapers; motion with power at this frequency has not. Before, the trace is differenced twice,
which removes slow motion, and values beyond the noise are clipped, which removes steps and impacts.

Periodic motion makes lines too. A line is not that of the mains where lines in the neighbouring bands are as clear, so
`neighbours` gives the chance of the clearest of those.

Source: Thomson 1982, harmonic F-test; Riedel and Sidorenko 1995, sine tapers. Differs from source: differences first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base import Channel
from ..signals import MAD_TO_SIGMA

CUT = 5.0  # standard deviations of the noise to which second differences are clipped
MOST, FEWEST = 9, 4  # most and least number of tapers
UNEVEN = 0.2  # largest rms deviation of the intervals over their median, for a Fourier transform
LONGEST = 1 << 16  # most samples that are used
TRIED = 8.0  # number of tried frequencies over band / resolution; 2 would be independent ones
RATE = 6.0  # sample rate over the frequency, to which a faster log is averaged
UNCLEAR = 0.1  # chance above which neighbouring lines are not sought
NEIGHBOURS = (0.75, 0.86, 1.14, 1.32)  # centres of neighbouring bands without mains, times the frequency


class Line(NamedTuple):
    """A sine in one channel."""

    frequency: float  # Hz, by the clock of the log
    error: float  # standard error of the frequency, Hz
    amplitude: float  # SI
    chance: float  # probability that noise shows a line as clear within the searched band
    neighbours: float = 1.0  # chance of the clearest line in the neighbouring bands


class Spectrum(NamedTuple):
    """The spectra of a channel with each taper."""

    grid: np.ndarray  # Hz, shape (m,)
    y: np.ndarray  # Fourier transforms, shape (K, m)
    sums: np.ndarray  # sums of the tapers, shape (K,)
    step: float  # s
    duration: float  # s


def spectrum(channel: Channel, frequency: float) -> Spectrum | None:
    """The spectrum about a frequency, Hz; None where the trace is too short, slow or uneven for one."""
    time, value = channel.time[:LONGEST], channel.value[:LONGEST]
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    if value.size < 64 or np.sqrt(np.mean((steps / step - 1.0) ** 2)) > UNEVEN or 2.8 * frequency * step > 1.0:
        return None
    tapers = min(MOST, int(0.6 * frequency * float(time[-1] - time[0])) - 1)  # (K + 1)/(2 T) well below the frequency
    if tapers < FEWEST:
        return None
    even = np.interp(np.arange(time[0], time[-1], step), time, value)
    block = max(1, int(1.0 / (RATE * frequency * step)))
    second = np.diff(even[: even.size // block * block].reshape(-1, block).mean(axis=1), 2)
    second = second - np.median(second)
    most = CUT * MAD_TO_SIGMA * float(np.median(np.abs(second)))
    x = np.clip(second, -most, most) if most > 0.0 else second
    size, index = 1 << int(np.ceil(np.log2(4 * x.size))), np.arange(1, x.size + 1)
    order = np.arange(1, tapers + 1)[:, None]
    windows = np.sqrt(2.0 / (x.size + 1)) * np.sin(np.pi * order * index / (x.size + 1))
    transform = np.fft.rfft(windows * x, size, axis=1)
    return Spectrum(
        np.fft.rfftfreq(size, block * step), transform, windows.sum(axis=1), block * step, x.size * block * step
    )


def line_near(s: Spectrum, frequency: float, band: float) -> Line:
    """The clearest line within `frequency` (1 +- band), Hz."""
    line = _clearest(s, frequency, band)
    if line.chance > UNCLEAR:
        return line
    return line._replace(neighbours=min(_clearest(s, part * frequency, band).chance for part in NEIGHBOURS))


def _clearest(s: Spectrum, frequency: float, band: float) -> Line:
    first, last = np.searchsorted(s.grid, [(1.0 - band) * frequency, (1.0 + band) * frequency])
    tapers, y = s.sums.size, s.y[:, first:last]
    if first == last:
        return Line(frequency, np.inf, 0.0, 1.0)
    mu = np.sum(s.sums[:, None] * y, axis=0) / np.sum(s.sums**2)
    left = np.sum(np.abs(y - s.sums[:, None] * mu) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.nan_to_num((tapers - 1) * np.abs(mu) ** 2 * np.sum(s.sums**2) / left, nan=0.0, posinf=1e12)
    k = int(np.argmax(f))
    at, clear = float(s.grid[first + k]), float(f[k])
    tried = 1.0 + TRIED * band * frequency * s.duration
    alone = (1.0 + clear / (tapers - 1)) ** (1 - tapers)
    gain = abs(2.0 * np.sin(np.pi * at * s.step)) ** 2  # of two differences
    error = np.sqrt(6.0 / max(clear, 1e-9)) / (np.pi * s.duration)
    return Line(at, float(error), 2.0 * float(abs(mu[k])) / gain, float(min(1.0, tried * alone)))
