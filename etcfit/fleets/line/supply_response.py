"""How much slower a weak battery opens."""

from __future__ import annotations

import numpy as np

from .base import AbstractFigure, FigureResult, finite
from .station import Station


class SupplyResponse(AbstractFigure):
    """Opening time at 9 V over that at 14 V, whatever the condition's own supply."""

    name = "supply_response"
    unit = "1"
    meaning = "opening time at 9 V over that at 14 V"
    source = "this project; 9 to 16 V as of ISO 16750-2, code C"

    def of(self, station: Station) -> FigureResult:
        slow, fast = (station.opening(v) for v in (station.settings.low_supply, station.settings.high_supply))
        told = np.isfinite(slow) & np.isfinite(fast)
        return finite(np.where(told, slow, np.nan) / np.where(told, fast, 1.0), "does not open fully at 9 V")
