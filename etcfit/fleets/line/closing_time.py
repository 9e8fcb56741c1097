"""How long a full stroke closed takes."""

from __future__ import annotations

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class ClosingTime(AbstractFigure):
    """t(10 %) - t(90 %) of the travel, from rest at the open stop, the supply switched on in reverse at full duty."""

    name = "closing_time"
    unit = "s"
    meaning = "time from 90 to 10 % of the travel at the full supply in reverse, closing"
    source = "transition duration, IEEE Std 181-2011, of a step of full duty"

    def of(self, station: Station) -> FigureResult:
        return finite(station.closing(station.condition.supply), "never reaches 10 % of the travel")
