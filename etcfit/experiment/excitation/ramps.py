"""Slow straight lines."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .base import AbstractShape


class Ramps(AbstractShape):
    """A triangle of the band's frequency: 0, 1, -1, 0 along straight lines.

    Slow, it shows spring and dry friction as the paper's static-load test does, without running into the stop.
    Source: the paper's static-load test. Differs from source: about half travel, in both directions.
    """

    name = "ramps"
    test = "response"
    bands: ClassVar[tuple[float, ...]] = (0.33, 1.0)

    def wave(self, time: np.ndarray, band: float) -> np.ndarray:
        return 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * band * time))

    def says(self, band: float) -> str:
        return f"ramps up and down, {band:g} a second"
