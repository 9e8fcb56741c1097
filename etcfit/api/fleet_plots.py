"""Pictures of a fleet as matplotlib Axes of figures that pyplot knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UsageError
from ..reporting.fleet import pictures
from ..reporting.fleet.page import Columns
from ..run_folder.fleet import FleetFiles
from .plots import panels_of


@dataclass(frozen=True)
class FleetPlots:
    """Pictures of a fleet; each gives its panels, shape (K,).

    Args:
        files: what lies in its run folder.
    """

    files: FleetFiles

    def population(self) -> np.ndarray:
        """Every unit's parameters with their intervals, and the population."""
        content = self.files.content
        return panels_of(lambda: pictures.draw_population(content, Columns.of(content["units"], self.files.units)))

    def correlation(self) -> np.ndarray:
        """Which parameters go together from unit to unit."""
        return panels_of(lambda: pictures.draw_correlation(self.files.content))

    def charts(self, *symbols: str) -> np.ndarray:
        """Control chart and cumulative sums, a figure a symbol.

        Args:
            symbols: which; all that have a chart where none is named.
        Raises:
            UsageError: a symbol has none.
        """
        there = self.files.content["charts"]
        if unknown := [symbol for symbol in symbols if symbol not in there]:
            raise UsageError(f"there is no chart of {unknown[0]}. There are: {', '.join(there) or 'none'}.")
        drawn = [panels_of(lambda s=s: pictures.draw_chart(self.files.content, s)) for s in symbols or there]
        return np.concatenate(drawn) if drawn else np.empty(0, dtype=object)

    def odd(self) -> np.ndarray:
        """How far each unit is from the population, and by what the odd ones are."""
        if not self.files.content["odd"]:
            raise UsageError("no unit of this fleet is odd: there is nothing to draw.")
        return panels_of(lambda: pictures.draw_odd(self.files.content))
