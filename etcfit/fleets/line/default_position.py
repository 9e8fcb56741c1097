"""Where the unpowered plate rests."""

from __future__ import annotations

import numpy as np

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class DefaultPosition(AbstractFigure):
    """Angle at which a plate let go from open, terminals open, comes to rest: the end of a simulated fall."""

    name = "default_position"
    unit = "rad"
    meaning = "angle at which the plate rests without a current, let go from open"
    source = "Deur et al. 2004 (limp-home position); from open, since dry friction keeps a memory of the side"

    def of(self, station: Station) -> FigureResult:
        rest = np.where(station.cut.still > 0.0, station.cut.angle, np.nan)
        return finite(rest, f"still moving after {station.settings.longest:g} s")
