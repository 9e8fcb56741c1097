"""The figures of a loop, each declared once with its formula; what they must stay below.

A new figure is one line of `LoopFigures`: JSON and its schema, terminal, page, DataFrame and reference follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, TypeVar

import numpy as np

from ..car_log.criteria import ACTIVITY, HELD, OVERSHOOT, SETTLING
from ..model.figure import Figure, figure, figures_of
from .response import (
    current_rms,
    duty_activity,
    overshoot,
    settling,
    steady_state_error,
    tracking_error,
)

Same = TypeVar("Same", bound="LoopFigures")


class By(Enum):
    """What a figure is computed of."""

    LEVEL = "the response at each level, the worst of them: AtLevel -> (...)"
    STRETCH = "the response over each stretch, the worst of them: Setpoint, Stretch, time, share -> (...)"
    RUN = "the whole response and its effort: Run -> (...)"
    HEAT = "current (rms, A), resistances of winding and bridge (ohm) -> W"
    MARGIN = "the linear loop; more is better"


@dataclass(frozen=True)
class LoopFigures:
    """How well a loop follows its setpoint, and what that costs; each a number, or an array over gains and models."""

    overshoot_pct: Any = figure(
        "%", "overshoot", "Largest excess beyond a new level, of the change of the setpoint, or of 1 % of the travel "
        "where that is more.", "overshoot", limit=OVERSHOOT.limit, by=By.LEVEL, formula=overshoot)  # fmt: skip
    settling_s: Any = figure(
        "s", "settling time", "From where the setpoint begins to change until the angle stays within 2 % of the "
        "change, or within 0.2 % of the travel where that is more; null where it does not settle.",
        "settling", limit=SETTLING.limit, by=By.LEVEL, formula=settling)  # fmt: skip
    steady_state_error_pct: Any = figure(
        "%", "steady-state error", "Largest error in the last quarter of a level, of the change, or of 40 % of the "
        "travel where that is more.", "error", limit=HELD.limit, by=By.LEVEL, formula=steady_state_error)  # fmt: skip
    rmse_pct: Any = figure(
        "%", "tracking error, root mean square", "Root mean square of the tracking error, of the travel (Eq. 9).",
        "RMSE", by=By.STRETCH, formula=tracking_error)  # fmt: skip
    gain_margin_db: Any = figure(
        "dB", "gain margin", "Of the linear loop; below 0 where it is unstable, null where it has none.",
        "gain\nmargin", limit=6.0, by=By.MARGIN)  # fmt: skip
    phase_margin_deg: Any = figure(
        "degrees", "phase margin", "Of the linear loop; null where it has none.",
        "phase\nmargin", limit=30.0, by=By.MARGIN)  # fmt: skip
    duty_activity_pct: Any = figure(
        "%", "duty activity at rest", "Standard deviation of the duty in the last quarter of a level, root mean "
        "square of all levels.", "duty", limit=ACTIVITY.limit, by=By.RUN, formula=duty_activity)  # fmt: skip
    current_rms_A: Any = figure(
        "A", "current, root mean square", "Root mean square of the current over all scenarios.",
        by=By.RUN, formula=current_rms)  # fmt: skip
    winding_W: Any = figure(
        "W", "heat in the winding", "Mean heat in the winding.",
        by=By.HEAT, formula=lambda current, winding, bridge: winding * current**2)  # fmt: skip
    bridge_W: Any = figure(
        "W", "heat in the bridge", "Mean heat in the bridge.",
        by=By.HEAT, formula=lambda current, winding, bridge: bridge * current**2)  # fmt: skip

    def known(self) -> dict[str, Any]:
        """The figures that there are, by symbol."""
        return {symbol: value for symbol in FIGURES if (value := getattr(self, symbol)) is not None}

    def each(self: Same, function: Callable[[Any], Any]) -> Same:
        """A function of each figure that there is."""
        return replace(self, **{symbol: function(value) for symbol, value in self.known().items()})

    def worst(self, of: Any = slice(None)) -> LoopFigures:
        """Each figure at its worst: the largest, of a margin the least.

        Args:
            of: which entries of the figures, arrays of shape (N,), count.
        """
        return LoopFigures(**{symbol: float((np.min if symbol in MARGINS else np.max)(value[of]))
                              for symbol, value in self.known().items()})  # fmt: skip


FIGURES: dict[str, Figure] = figures_of(LoopFigures)
"""Every figure of a loop, by symbol."""


def symbols_by(*kinds: By) -> tuple[str, ...]:
    return tuple(symbol for symbol, each in FIGURES.items() if each.how["by"] in kinds)


TRACKING = symbols_by(By.LEVEL, By.STRETCH)
MARGINS = symbols_by(By.MARGIN)
EFFORT = symbols_by(By.RUN, By.HEAT)
REQUIRED = (*TRACKING, *EFFORT)
OF_THE_PAPER = symbols_by(By.LEVEL)


@dataclass(frozen=True)
class Requirements(LoopFigures):
    """What the figures of a response must stay below; inf: no limit. By default the paper's limits (section 4.1), and
    a duty activity below 5 %. The margins are the least that the rule `optimal` looks for; the paper has none.

    Args:
        as in `LoopFigures`; what is left out is as declared there.
    """

    def __post_init__(self) -> None:
        for symbol, declared in FIGURES.items():
            if getattr(self, symbol) is None:
                object.__setattr__(self, symbol, declared.limit)

    def limits(self, symbols: tuple[str, ...] = REQUIRED) -> dict[str, float]:
        """The limit of each figure, inf for none."""
        return {symbol: getattr(self, symbol) for symbol in symbols}

    def finite(self) -> dict[str, float]:
        """What is limited, margins too."""
        return {symbol: limit for symbol, limit in self.limits(tuple(FIGURES)).items() if math.isfinite(limit)}

    def strain(self, figures: LoopFigures) -> dict[str, Any]:
        """Each figure over its limit: 1 or more where it is missed, 0 where nothing limits it."""
        return {symbol: getattr(figures, symbol) / limit if math.isfinite(limit) else np.zeros_like(figures.rmse_pct)
                for symbol, limit in self.limits().items()}  # fmt: skip

    def met(self, figures: LoopFigures, symbols: tuple[str, ...] = REQUIRED) -> dict[str, Any]:
        """figure < limit, entry by entry; a figure that is infinite or NaN never is."""
        return {symbol: getattr(figures, symbol) < limit for symbol, limit in self.limits(symbols).items()}
