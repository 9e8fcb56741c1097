"""What a shape of excitation has to say of itself."""

from __future__ import annotations

import abc
from typing import ClassVar

import numpy as np


class AbstractShape(abc.ABC):
    """A voltage about the one that balances the spring, as a share of its amplitude.

        v(t) = v_centre + A wave(t),    |wave| <= 1

    Where the plate is when it begins and ends, and how large A may be, is not the shape's concern (`candidates`).
    """

    name: ClassVar[str]
    test: ClassVar[str]  # the rig test whose folder takes the record
    bands: ClassVar[tuple[float, ...]]  # Hz, each a candidate

    @abc.abstractmethod
    def wave(self, time: np.ndarray, band: float) -> np.ndarray:
        """The shape, dimensionless, within +-1.

        Args:
            time: evenly spaced from 0, s, shape (n,).
            band: fastest that is in it, Hz.
        Returns:
            shape (n,).
        """

    @abc.abstractmethod
    def says(self, band: float) -> str:
        """What it is, in a few words for whoever plays it."""
