"""Requirements in words, and the one that figures miss by most, or meet most narrowly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from ...control.pid.figures import FIGURES, MARGINS
from ..numbers import short


class Hardest(NamedTuple):
    """A requirement and the figure that is held to it.

    Args:
        symbol: of `LoopFigures`.
        figure: infinite where, say, a response does not settle.
        limit: that it must stay below.
    """

    symbol: str
    figure: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether the figure is what is required."""
        return self.figure < self.limit

    @property
    def strain(self) -> float:
        """The figure over its limit: above 1 it is missed."""
        return self.figure / self.limit

    @property
    def says(self) -> str:
        """ "overshoot 54.2 % (limit 20 %)"."""
        of = FIGURES[self.symbol]
        if math.isfinite(self.figure):
            said = f"{of.name} {short(self.figure)} {of.unit}"
        else:
            said = "no settling" if self.symbol == "settling_s" else f"no finite {of.name}"
        return f"{said} (limit {self.limit:g} {of.unit})"


def hardest(figures: Mapping[str, float | None], limits: Mapping[str, float | None]) -> Hardest | None:
    """The requirement that is missed by most, or met most narrowly; None where nothing has a limit.

    Args:
        figures: by requirement; None or NaN for what is never reached. What has no figure is not judged.
        limits: by requirement, what a figure must stay below; None or infinite for none.
    """
    asked = {symbol: limit for symbol, limit in limits.items() if limit is not None and math.isfinite(limit)}
    every = [Hardest(symbol, _reached(figures[symbol]), limit) for symbol, limit in asked.items() if symbol in figures]
    return max(every, key=lambda each: each.strain, default=None)


def missed_margins(figures: Mapping[str, float | None], asked: Mapping[str, float]) -> list[str]:
    """Each stability margin that is less than what is asked for, in words.

    Args:
        figures, asked: by margin; a figure is None or infinite where the loop has no such margin.
    """
    less = ((FIGURES[symbol], figures.get(symbol), asked[symbol]) for symbol in MARGINS if symbol in asked)
    return [f"{of.name} {short(value)} {of.unit} (at least {least:g} {of.unit})"
            for of, value, least in less if value is not None and value < least]  # fmt: skip


def _reached(figure: float | None) -> float:
    return math.inf if figure is None or math.isnan(figure) else float(figure)
