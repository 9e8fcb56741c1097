"""What the fleet will measure where it is hot or cold, on a weak battery or a charged one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...estimation.fitted_model import FleetModel
from . import FIGURE_BY_NAME, measured
from .base import FigureResult
from .conditions import Condition, conditions
from .settings import LINE, WARMTH, LineSettings, TemperatureSettings

_ENDS = (0.025, 0.975)


@dataclass(frozen=True)
class Spread:
    """A figure over the units of a fleet.

    Args:
        mean, sd: of the units that it can be told of, SI; None where it can be told of none, or of one alone.
        low, high: 2.5 and 97.5 % of them.
        unit: SI.
        told: units that it can be told of.
        why: it cannot be told of the others.
    """

    mean: float | None
    sd: float | None
    low: float | None
    high: float | None
    unit: str
    told: int
    why: str

    @classmethod
    def of(cls, told: FigureResult, unit: str) -> Spread:
        """Of a figure of every unit."""
        known = told.value[np.isfinite(told.value)]
        if not known.size:
            return cls(None, None, None, None, unit, 0, told.why)
        low, high = (float(v) for v in np.quantile(known, _ENDS))
        sd = float(np.std(known, ddof=1)) if known.size > 1 else None
        return cls(float(np.mean(known)), sd, low, high, unit, known.size, told.why)


@dataclass(frozen=True)
class Prediction:
    """Every figure over the fleet under one condition.

    Args:
        condition: which.
        figures: by name.
    """

    condition: Condition
    figures: Mapping[str, Spread]


def predict(
    model: FleetModel,
    under: tuple[Condition, ...] | None = None,
    settings: LineSettings = LINE,
    warmth: TemperatureSettings = WARMTH,
) -> tuple[Prediction, ...]:
    """Mean, 2.5 and 97.5 % of the units, figure by figure, under each condition; one compilation for all.

    Args:
        model: the units.
        under: conditions; None for bench, hot and cold at 9, 12, 14 and 16 V.
        settings, warmth: see there.
    """
    every = conditions(warmth=warmth) if under is None else under
    return tuple(Prediction(each, spreads(measured(model, each, settings, warmth))) for each in every)


def spreads(figures: Mapping[str, FigureResult]) -> dict[str, Spread]:
    """What `measured` says, over the units."""
    return {name: Spread.of(told, FIGURE_BY_NAME[name].unit) for name, told in figures.items()}
