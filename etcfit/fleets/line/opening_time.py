"""How long a full stroke open takes."""

from __future__ import annotations

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class OpeningTime(AbstractFigure):
    """t(90 %) - t(10 %) of the travel, from rest at the closed stop, the supply switched on at full duty."""

    name = "opening_time"
    unit = "s"
    meaning = "time from 10 to 90 % of the travel at the full supply, opening"
    source = "transition duration, IEEE Std 181-2011, of a step of full duty"

    def of(self, station: Station) -> FigureResult:
        return finite(station.opening(station.condition.supply), "never reaches 90 % of the travel")
