"""How long the springs take, terminals open."""

from __future__ import annotations

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class UnpoweredReturn(AbstractFigure):
    """From the open stop until the plate stays within 5 % of the travel about where its springs bring it."""

    name = "unpowered_return"
    unit = "s"
    meaning = "time from full open to within 5 % of the unpowered position, terminals open"
    source = "control.safety.spring_return: FMVSS 124 asks it of the driver's control"

    def of(self, station: Station) -> FigureResult:
        return finite(station.cut.stays[:, 0], "rests more than 5 % of the travel from where its springs bring it")
