"""Steps between levels."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .base import AbstractShape

_SEED = 2015  # the same levels every time, so that a plan made twice is the same plan


class Steps(AbstractShape):
    """Levels above and below the middle in turn, each held for 1 to 3 halves of the band's period.

        wave = +-a_k,    a_k uniform in 0.4 to 1, the largest 1

    Source: amplitude-modulated pseudo-random signals, Nelles 2001, ch. 17. Differs from source: sides alternate, for a
    plate between two stops must come back.
    """

    name = "steps"
    test = "response"
    bands: ClassVar[tuple[float, ...]] = (2.0, 5.0)

    def wave(self, time: np.ndarray, band: float) -> np.ndarray:
        rng = np.random.default_rng(_SEED)
        half = 0.5 / band
        count = int(time[-1] / half) + 2
        size = rng.uniform(0.4, 1.0, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
        ends = np.cumsum(half * rng.integers(1, 4, count))
        wave = size[np.searchsorted(ends, time, side="right")]
        return wave / np.abs(wave).max()

    def says(self, band: float) -> str:
        return f"steps to either side, {0.5 / band:.2g} to {1.5 / band:.2g} s each"
