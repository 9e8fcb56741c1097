"""Smoothing and derivative by a parabola through the samples about each one.

    y(t + k step) ~ c_0 + c_1 k + c_2 k^2,   |k| <= window // 2,   least squares;   y ~ c_0,   dy/dt ~ c_1 / step

Source: Savitzky and Golay 1964 (Anal. Chem. 36), eq. 11. Differs from source: within half a window of an end the
parabola of the end's own window is read off beside its middle. It is SciPy's `savgol_filter(y, window, 2)`, which
loads all of `scipy.signal` and `scipy.stats`: a second of every command that reads a folder.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float


def smoothed(y: Float[np.ndarray, " n"], window: int) -> Float[np.ndarray, " n"]:
    """On an even grid.

    Args:
        y: n >= window samples.
        window: odd.
    """
    return _read_off(y, window, lambda c, k: c[0] + c[1] * k + c[2] * k**2)


def slope(y: Float[np.ndarray, " n"], window: int, step: float) -> Float[np.ndarray, " n"]:
    """dy/dt on an even grid; arguments as for `smoothed`, step in s."""
    return _read_off(y, window, lambda c, k: (c[1] + 2.0 * c[2] * k) / step)


def _read_off(
    y: np.ndarray, window: int, at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Float[np.ndarray, " n"]:
    """`at` of coefficients (3, ...) and places k: in the middle of each window, and all along the first and last."""
    half = window // 2
    k = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.vander(k, 3, increasing=True))
    middle = np.convolve(y, at(fit, np.zeros(1))[::-1], "valid")
    begin, end = fit @ y[:window], fit @ y[len(y) - window :]
    return np.concatenate([at(begin, k[:half]), middle, at(end, k[half + 1 :])])
