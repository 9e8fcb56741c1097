"""Many sines at once."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .base import AbstractShape

_FIRST = 0.4  # Hz, the slowest of them
_COUNT = 8


class Multisine(AbstractShape):
    """Sum of sines, logarithmically spaced up to the band, their phases those of a low peak:

        wave = sum_k sin(2 pi f_k t + phi_k) / peak,    phi_k = -pi k (k - 1) / K

    Source: Schroeder 1970, IEEE Trans. Inf. Theory 16:85. Differs from source: the lines are spaced by ratios.
    """

    name = "multisine"
    test = "response"
    bands: ClassVar[tuple[float, ...]] = (3.0, 10.0)

    def wave(self, time: np.ndarray, band: float) -> np.ndarray:
        hertz = np.geomspace(_FIRST, band, _COUNT)
        k = np.arange(1, _COUNT + 1)
        sines = np.sin(2.0 * np.pi * np.outer(time, hertz) - np.pi * k * (k - 1) / _COUNT).sum(axis=1)
        return sines / np.abs(sines).max()

    def says(self, band: float) -> str:
        return f"multisine, {_COUNT} lines {_FIRST:g} to {band:g} Hz"
