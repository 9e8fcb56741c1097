"""What holding costs."""

from __future__ import annotations

import numpy as np

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class HoldingCurrent(AbstractFigure):
    """(i_open + i_close) / 2 at mid-travel, the currents at which the plate is about to move either way."""

    name = "holding_current"
    unit = "A"
    meaning = "current that holds the plate at mid-travel, the middle of its hysteresis"
    source = "the paper, Eq. 2 at rest"

    def of(self, station: Station) -> FigureResult:
        angles = np.full(station.count, station.angle(station.settings.middle))
        opening, closing = (station.held(angles, share)[0] for share in (1.0, -1.0))
        return finite(0.5 * (opening + closing), "no current holds it")
