"""When an open plate starts to close."""

from __future__ import annotations

import numpy as np

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class BreakawayVoltageClosing(AbstractFigure):
    """Voltage below which a plate at the open stop starts to close, of a slow ramp down."""

    name = "breakaway_voltage_closing"
    unit = "V"
    meaning = "voltage of a falling slow ramp at which the plate leaves the open stop"
    source = "the paper, Eqs. 1-2 at rest"

    def of(self, station: Station) -> FigureResult:
        return finite(station.held(np.full(station.count, station.body.upper), -1.0)[1], "no voltage moves it")
