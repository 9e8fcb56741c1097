"""Requirements in words, and the one that figures miss by most, or meet most narrowly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from ..numbers import short

WORDS = {
    "overshoot_pct": ("overshoot", "%"),
    "settling_s": ("settling time", "s"),
    "steady_state_error_pct": ("steady-state error", "%"),
    "rmse_pct": ("tracking error, root mean square", "%"),
    "duty_activity_pct": ("duty activity at rest", "%"),
    "current_rms_A": ("current, root mean square", "A"),
    "winding_W": ("heat in the winding", "W"),
    "bridge_W": ("heat in the bridge", "W"),
    "gain_margin_db": ("gain margin", "dB"),
    "phase_margin_deg": ("phase margin", "degrees"),
}
"""Name and unit, by field of `Requirements` and `Metrics`."""

_MARGINS = ("gain_margin_db", "phase_margin_deg")  # of which more is better; None where a loop has none


class Hardest(NamedTuple):
    """A requirement and the figure that is held to it.

    Args:
        symbol: a key of `WORDS`.
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
        name, unit = WORDS[self.symbol]
        if math.isfinite(self.figure):
            said = f"{name} {short(self.figure)} {unit}"
        else:
            said = "no settling" if self.symbol == "settling_s" else f"no finite {name}"
        return f"{said} (limit {self.limit:g} {unit})"


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
    less = ((symbol, figures.get(symbol)) for symbol in _MARGINS if symbol in asked)
    return [f"{WORDS[symbol][0]} {short(value)} {WORDS[symbol][1]} (at least {asked[symbol]:g} {WORDS[symbol][1]})"
            for symbol, value in less if value is not None and value < asked[symbol]]  # fmt: skip


def _reached(figure: float | None) -> float:
    return math.inf if figure is None or math.isnan(figure) else float(figure)
