"""`figures` and `predictions` of fleet.json: what a line measures, unit by unit and under the conditions to come."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ..fleets.line import FIGURE_BY_NAME, FigureResult
from ..fleets.prediction import Prediction, Spread


def figures_json(
    units: tuple[str, ...], measured: Mapping[str, FigureResult], odd: Collection[str] = ()
) -> dict[str, Any]:
    """Each figure of every unit of which it can be told, and over the ordinary ones; `why` it cannot of the others.

    Args:
        units: their names.
        measured: what `fleets.line.measured` gave.
        odd: names of units that do not count in mean and spread.
    """
    ordinary = ~np.isin(units, list(odd))
    return {
        name: {
            "meaning": FIGURE_BY_NAME[name].meaning,
            **asdict(Spread.over_units(FigureResult(told.value[ordinary], told.why), FIGURE_BY_NAME[name].unit)),
            "value": {unit: float(v) for unit, v in zip(units, told.value, strict=True) if np.isfinite(v)},
        }
        for name, told in measured.items()
    }


def predictions_json(predictions: Iterable[Prediction]) -> list[dict[str, Any]]:
    """Every condition with the spread of each figure over the units; figures that can be told of no unit are null."""
    return [
        {
            "condition": each.condition.name,
            "winding_C": each.condition.winding,
            "supply_V": each.condition.supply,
            "friction": each.condition.friction,
            "figures": {name: asdict(figure) for name, figure in each.figures.items()},
        }
        for each in predictions
    ]
