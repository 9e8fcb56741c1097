"""How long the springs take against a shorted motor."""

from __future__ import annotations

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class UnpoweredReturnShorted(AbstractFigure):
    """From the open stop until the plate stays within 5 % of the travel about where its springs bring it."""

    name = "unpowered_return_shorted"
    unit = "s"
    meaning = "time from full open to within 5 % of the unpowered position, terminals shorted"
    source = "control.safety.spring_return"

    def of(self, station: Station) -> FigureResult:
        return finite(station.shorted.stays[:, 0], "not back while watched: dry friction or the motor's brake holds it")
