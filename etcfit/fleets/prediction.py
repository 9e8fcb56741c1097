"""What the fleet will measure where it is hot or cold, on a weak battery or a charged one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..estimation.fitted_model import FleetModel
from .line import BENCH, FIGURE_BY_NAME, Condition, FigureResult, measured

SUPPLIES = (9.0, 12.0, 14.0, 16.0)  # V
HOT, COLD = BENCH + 80.0, -40.0  # degrees Celsius
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
    def over_units(cls, figure: FigureResult, unit: str) -> Spread:
        """Of a figure of every unit."""
        known = figure.value[np.isfinite(figure.value)]
        if not known.size:
            return cls(None, None, None, None, unit, 0, figure.why)
        low, high = (float(v) for v in np.quantile(known, _ENDS))
        sd = float(np.std(known, ddof=1)) if known.size > 1 else None
        return cls(float(np.mean(known)), sd, low, high, unit, known.size, figure.why)


@dataclass(frozen=True)
class Prediction:
    """Every figure over the fleet under one condition.

    Args:
        condition: which.
        figures: by name.
    """

    condition: Condition
    figures: Mapping[str, Spread]


def conditions(supplies: tuple[float, ...] = SUPPLIES, cold_friction: float = 1.0) -> tuple[Condition, ...]:
    """Bench, hot and cold at each supply.

    Args:
        supplies: V.
        cold_friction: dry friction over that of the bench in the cold. 1 leaves it alone: how a grease stiffens is its
            own affair, and no measurement at the bench tells it.
    """
    states = (("bench", BENCH, 1.0), ("hot", HOT, 1.0), ("cold", COLD, cold_friction))
    return tuple(
        Condition(f"{name}, {supply:g} V", supply, winding, friction)
        for (name, winding, friction), supply in product(states, supplies)
    )


CONDITIONS = conditions()


def predict(model: FleetModel, under: tuple[Condition, ...] = CONDITIONS) -> tuple[Prediction, ...]:
    """Mean, 2.5 and 97.5 % of the units, figure by figure, under each condition; one compilation for all."""
    out = []
    for condition in under:
        found = measured(model, condition)
        figures = {name: Spread.over_units(figure, FIGURE_BY_NAME[name].unit) for name, figure in found.items()}
        out.append(Prediction(condition, figures))
    return tuple(out)
