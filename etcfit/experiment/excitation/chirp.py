"""A sine that grows faster."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .base import AbstractShape

_FIRST = 0.4  # Hz, where it begins


class Chirp(AbstractShape):
    """wave = sin(2 pi f_0 (e^(r t) - 1) / r),    r = ln(band / f_0) / T

    Source: Farina 2000 (exponential sweep). Differs from source: no.
    """

    name = "chirp"
    test = "response"
    bands: ClassVar[tuple[float, ...]] = (3.0, 10.0)

    def wave(self, time: np.ndarray, band: float) -> np.ndarray:
        rate = np.log(band / _FIRST) / time[-1]
        return np.sin(2.0 * np.pi * _FIRST * np.expm1(rate * time) / rate)

    def says(self, band: float) -> str:
        return f"sine sweep {_FIRST:g} to {band:g} Hz"
