"""In which unit a quantity is shown: angles in degrees whatever the sensor, all else as logged or with a prefix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...estimation.joint_fit import FitResult
from ...problem.prediction_error import PredictionError, logged_unit
from ...problem.trace import Trace
from ..pictures import all_traces
from ..stack import source

DEGREES = 180.0 / np.pi
_SMALL = 0.2  # below which a thousandth is the better unit
_THOUSANDTHS = ("N m", "V", "A")


def prefixed(limit: float, unit: str) -> tuple[float, str]:
    """Factor and unit for values up to `limit`, given in SI."""
    unit = unit.replace("*", " ")
    if unit == "rad":
        return DEGREES, "deg"
    return (1e3, f"m{unit}") if limit < _SMALL and unit in _THOUSANDTHS else (1.0, unit or "1")


@dataclass(frozen=True, eq=False)
class Shown:
    """One channel of a trace as it is shown.

    Args:
        unit: of the values shown.
        size: that unit in SI.
        origin: what is shown as zero, SI.
    """

    unit: str
    size: float
    origin: float = 0.0

    @classmethod
    def of(cls, trace: Trace, name: str) -> Shown:
        """Degrees for the position, the logged unit for anything else."""
        if name == "position":
            return cls("deg", 1.0 / DEGREES)
        logged = source(trace, name)
        return cls(logged.unit or "1", logged.scale, logged.offset)

    def __call__(self, value: np.ndarray) -> np.ndarray:
        return (value - self.origin) / self.size


def scales(result: FitResult) -> dict[str, float]:
    """Degrees in one logged unit of position, by file."""
    return {t.measurement.file: DEGREES * logged_unit(t, "position")[1]
            for t in all_traces(result) if "position" in t.channels}  # fmt: skip


def in_degrees(rows: Sequence[PredictionError], scales: Mapping[str, float]) -> tuple[PredictionError, ...]:
    """Errors of the position in degrees; the other rows as they are."""
    return tuple(
        replace(r, unit="deg", rms=r.rms * scales[r.file], sigma=r.sigma * scales[r.file])
        if r.channel == "position" and r.file in scales
        else r
        for r in rows
    )
