"""What every figure of a line is: one number a unit, computed from its fitted model."""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import numpy as np

from .station import PerUnit, Station


class FigureResult(NamedTuple):
    """A figure of every unit.

    Args:
        value: SI, shape (U,); NaN where it cannot be told.
        why: of the NaN; "" where there is none.
    """

    value: PerUnit
    why: str = ""


class AbstractFigure(abc.ABC):
    """One figure.

    Attributes:
        name: what fleet.json and the limits of fleet.toml call it.
        unit: SI.
        meaning: one line.
        source: of its definition.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    meaning: ClassVar[str]
    source: ClassVar[str]

    @abc.abstractmethod
    def of(self, station: Station) -> FigureResult:
        """Of every unit at a station."""


def finite(value: PerUnit, why: str) -> FigureResult:
    """What is not finite cannot be told, and why."""
    known = np.isfinite(value)
    return FigureResult(np.where(known, value, np.nan), "" if known.all() else why)
