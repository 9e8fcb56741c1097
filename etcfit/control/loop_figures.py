"""The figures of a loop and their limits: their formulas (the paper's sections 4.1 and 4.3, Eq. 9) for a response, each
declared in one place.

A new figure is one line of `LoopFigures`: JSON and its schema, terminal, page, DataFrame and reference follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..car_log.criteria import (
    ACTIVITY,
    HELD,
    LEAST_HELD,
    LEAST_OVERSHOT,
    NEGLIGIBLE,
    OVERSHOOT,
    SETTLED,
    SETTLING,
    TAIL,
)
from ..model.figure import Figure, figure, figures_of
from .setpoint import Level, Setpoint, Stretch


class AtLevel(NamedTuple):
    """A response between two changes of the setpoint."""

    size: float  # of the change, share of the travel
    since: np.ndarray  # s since the change began, shape (K,)
    # distance of the position beyond the new level, in the direction of the change, shares of the travel, shape (...,
    # K)
    beyond: np.ndarray
    tail: int  # number of the first tick of the level's last quarter

    @classmethod
    def of_responses(cls, level: Level, time: np.ndarray, share: np.ndarray) -> AtLevel:
        """Args: level; time: s, shape (K,); share: of the travel, shape (..., K)."""
        begin, end = index(time, level.begins), index(time, level.ends)
        beyond = (share[..., begin:end] - level.after) * np.sign(level.change)
        return cls(abs(level.change), time[begin:end] - level.begins, beyond, _tail(begin, end) - begin)

    @property
    def far(self) -> np.ndarray:
        """Distance from the level."""
        return np.abs(self.beyond)


class Run(NamedTuple):
    """A whole response."""

    setpoint: Setpoint  # the setpoint that it follows
    time: np.ndarray  # s, shape (K,)
    duty: np.ndarray  # share of the supply, shape (..., K)
    current: np.ndarray  # A, shape (..., K)


def overshoot(at: AtLevel) -> np.ndarray:
    """%, of the change."""
    return 100.0 * np.maximum(np.max(at.beyond, axis=-1), 0.0) / max(at.size, LEAST_OVERSHOT)


def settling(at: AtLevel) -> np.ndarray:
    """s, until the first tick after the last one outside."""
    since = np.append(at.since, np.inf)
    outside = at.far > max(SETTLED * at.size, NEGLIGIBLE)
    last = outside.shape[-1] - np.argmax(outside[..., ::-1], axis=-1)
    return np.where(outside.any(axis=-1), since[last], 0.0)


def steady_state_error(at: AtLevel) -> np.ndarray:
    """%, of the change."""
    return 100.0 * np.max(np.abs(at.beyond[..., at.tail :]), axis=-1) / max(at.size, LEAST_HELD)


def tracking_error(setpoint: Setpoint, stretch: Stretch, time: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Root mean square over a stretch, % of the travel (Eq. 9)."""
    part = slice(index(time, stretch.begins), index(time, stretch.ends))
    return 100.0 * np.sqrt(np.mean(np.square(share[..., part] - setpoint.at(time[part])), axis=-1))


def duty_activity(run: Run) -> np.ndarray:
    """Standard deviation of the duty in the last quarter of a level, root mean square of all levels, %."""
    ends = ((index(run.time, level.begins), index(run.time, level.ends)) for level in run.setpoint.levels)
    moved = [np.var(run.duty[..., _tail(begin, end) : end], axis=-1) for begin, end in ends]
    return 100.0 * np.sqrt(np.mean(np.stack(moved), axis=0))


def current_rms(run: Run) -> np.ndarray:
    """A."""
    judged = run.current[..., index(run.time, run.setpoint.judged_from) :]
    return np.sqrt(np.mean(np.square(judged), axis=-1))


def index(time: np.ndarray, instant: float) -> int:
    """First tick at or after an instant (s)."""
    return int(np.searchsorted(time, instant - 0.5 * (time[1] - time[0])))


def _tail(begin: int, end: int) -> int:
    """First tick of a level's last quarter."""
    return begin + round((1.0 - TAIL) * (end - begin))


Same = TypeVar("Same", bound="LoopFigures")


class By(Enum):
    """The data from which a figure is computed."""

    LEVEL = "the response at each level, the worst of them: AtLevel -> (...)"
    STRETCH = "the response over each stretch, the worst of them: Setpoint, Stretch, time, share -> (...)"
    RUN = "the whole response and its effort: Run -> (...)"
    HEAT = "current (rms, A), resistances of winding and bridge (ohm) -> W"
    MARGIN = "the linear loop; more is better"


@dataclass(frozen=True)
class LoopFigures:
    """The figures of tracking and of effort of a loop; each is a number, or an array over gains and models."""

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
        """The figures that are not None, by symbol."""
        return {symbol: value for symbol in FIGURES if (value := getattr(self, symbol)) is not None}

    def each(self: Same, function: Callable[[Any], Any]) -> Same:
        """The figures with a function applied to each that is not None."""
        return replace(self, **{symbol: function(value) for symbol, value in self.known().items()})

    def worst(self, of: Any = slice(None)) -> LoopFigures:
        """Each figure at its worst: the largest, for a margin the least.

        Args:
            of: the entries of the figures (arrays of shape (N,)) that are included.
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
    """Upper limits of the figures of a response; inf: no limit. The defaults are the paper's limits (section 4.1), and
    a duty activity below 5 %. The margins are lower limits for the rule `optimal`; the paper has none.

    Args:
        as in `LoopFigures`; the defaults are the limits declared there.
    """

    def __post_init__(self) -> None:
        for symbol, declared in FIGURES.items():
            if getattr(self, symbol) is None:
                object.__setattr__(self, symbol, declared.limit)

    def limits(self, symbols: tuple[str, ...] = REQUIRED) -> dict[str, float]:
        """The limit of each figure, inf for none."""
        return {symbol: getattr(self, symbol) for symbol in symbols}

    def finite(self) -> dict[str, float]:
        """The finite limits, including the margins."""
        return {symbol: limit for symbol, limit in self.limits(tuple(FIGURES)).items() if math.isfinite(limit)}

    def strain(self, figures: LoopFigures) -> dict[str, Any]:
        """Each figure over its limit: 1 or more where the limit is missed, 0 where there is no limit."""
        return {symbol: getattr(figures, symbol) / limit if math.isfinite(limit) else np.zeros_like(figures.rmse_pct)
                for symbol, limit in self.limits().items()}  # fmt: skip

    def met(self, figures: LoopFigures, symbols: tuple[str, ...] = REQUIRED) -> dict[str, Any]:
        """figure < limit, entry by entry; False for a figure that is infinite or NaN."""
        return {symbol: getattr(figures, symbol) < limit for symbol, limit in self.limits(symbols).items()}


def judge(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> LoopFigures:
    """The figures of a response: each is the worst of all levels, or of all stretches.

    Args:
        time: s, shape (K,), from 0 with an even step.
        share: position, share of the travel, shape (..., K); a value that is not finite counts as an infinite error.
    """
    return _tracking(setpoint, setpoint.levels, setpoint.stretches, time, _infinite_where_none(share))


def _infinite_where_none(share: np.ndarray) -> np.ndarray:
    """The values, infinite where they are not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.sum(share)  # a pass without an array of its own
    return share if np.isfinite(total) else np.where(np.isfinite(share), share, np.inf)


def judge_each(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> dict[str, LoopFigures]:
    """The figures of each scenario, with the tracking error over the whole scenario.

    A log has no levels: only its tracking error is known, and its other figures are NaN.
    """
    share, out = _infinite_where_none(share), {}
    for name in setpoint.scenarios:
        levels = setpoint.only(name)
        parts = [part for part in (*levels, *setpoint.stretches) if part.scenario == name]
        whole = Stretch(min(part.begins for part in parts), max(part.ends for part in parts))
        out[name] = _tracking(setpoint, levels, (whole,), time, share)
    return out


def _tracking(setpoint: Setpoint, levels: Any, stretches: Any, time: np.ndarray, share: np.ndarray) -> LoopFigures:
    at = [AtLevel.of_responses(level, time, share) for level in levels]
    nothing = np.full(share.shape[:-1], np.nan)

    def worst(symbol: str) -> np.ndarray:
        formula = FIGURES[symbol].how["formula"]
        if FIGURES[symbol].how["by"] is By.LEVEL:
            every = [formula(each) for each in at]
        else:
            every = [formula(setpoint, stretch, time, share) for stretch in stretches]
        return np.max(np.stack(every), axis=0) if every else nothing

    return LoopFigures(**{symbol: worst(symbol) for symbol in TRACKING})


def with_effort(figures: LoopFigures, run: Run) -> LoopFigures:
    """The figures with those of the effort of the response."""
    return replace(figures, **{symbol: FIGURES[symbol].how["formula"](run) for symbol in symbols_by(By.RUN)})


def with_heat(figures: LoopFigures, winding: Any, bridge: float) -> LoopFigures:
    """The figures with the heat of the current in the resistances of winding and bridge (ohm)."""
    current = figures.current_rms_A
    return replace(
        figures, **{symbol: FIGURES[symbol].how["formula"](current, winding, bridge) for symbol in symbols_by(By.HEAT)}
    )
