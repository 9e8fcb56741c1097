"""When the plate starts to open."""

from __future__ import annotations

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class BreakawayVoltageOpening(AbstractFigure):
    """Least voltage of a slow ramp at which a plate at rest in its unpowered position starts to open."""

    name = "breakaway_voltage_opening"
    unit = "V"
    meaning = "voltage at which a slow ramp starts to open the plate from its unpowered position"
    source = "the paper, Eqs. 1-2 at rest"

    def of(self, station: Station) -> FigureResult:
        return finite(station.held(station.cut.angle, 1.0)[1], "no voltage moves it")
