"""What a production line measures, computed from the fitted models of many units; a newcomer adds one file here."""

from __future__ import annotations

from collections.abc import Mapping

from ...estimation.fitted_model import FleetModel
from .base import AbstractFigure, FigureResult
from .breakaway_voltage_closing import BreakawayVoltageClosing
from .breakaway_voltage_opening import BreakawayVoltageOpening
from .closing_time import ClosingTime
from .conditions import Condition, at_bench
from .current_hysteresis import CurrentHysteresis
from .default_position import DefaultPosition
from .holding_current import HoldingCurrent
from .opening_time import OpeningTime
from .sensor_linearity import SensorLinearity
from .settings import LINE, WARMTH, LineSettings, TemperatureSettings
from .station import Station
from .supply_response import SupplyResponse
from .unpowered_return import UnpoweredReturn
from .unpowered_return_shorted import UnpoweredReturnShorted

# the one registration; tables and pages have this order
FIGURES: tuple[AbstractFigure, ...] = tuple(
    figure()
    for figure in (
        DefaultPosition,
        OpeningTime,
        ClosingTime,
        UnpoweredReturn,
        UnpoweredReturnShorted,
        SupplyResponse,
        HoldingCurrent,
        CurrentHysteresis,
        BreakawayVoltageOpening,
        BreakawayVoltageClosing,
        SensorLinearity,
    )
)

FIGURE_BY_NAME: Mapping[str, AbstractFigure] = {figure.name: figure for figure in FIGURES}


def measured(
    model: FleetModel,
    condition: Condition | None = None,
    settings: LineSettings = LINE,
    warmth: TemperatureSettings = WARMTH,
) -> dict[str, FigureResult]:
    """Every figure of every unit.

    Args:
        model: the units.
        condition: of all of them; None for the bench at the line's own supply.
        settings: of the figures.
        warmth: what a temperature does.
    Returns:
        by the figure's name, in the order of `FIGURES`.
    """
    station = Station(model, condition or at_bench(settings, warmth), settings, warmth)
    return {figure.name: figure.of(station) for figure in FIGURES}


__all__ = [
    "FIGURES",
    "FIGURE_BY_NAME",
    "AbstractFigure",
    "Condition",
    "FigureResult",
    "LineSettings",
    "Station",
    "TemperatureSettings",
    "measured",
]  # fmt: skip
