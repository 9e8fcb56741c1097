"""How far apart the currents are that open and close."""

from __future__ import annotations

import numpy as np

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class CurrentHysteresis(AbstractFigure):
    """(i_open - i_close) / 2 at mid-travel, of a slow ramp up and one down."""

    name = "current_hysteresis"
    unit = "A"
    meaning = "half the difference of the slow opening and closing current at mid-travel"
    source = "the paper, Eq. 2 at rest: T_f / (N K_m) of Eqs. 1-2"

    def of(self, station: Station) -> FigureResult:
        angles = np.full(station.count, station.angle(station.settings.middle))
        opening, closing = (station.held(angles, share)[0] for share in (1.0, -1.0))
        return finite(0.5 * (opening - closing), "no current moves it")
