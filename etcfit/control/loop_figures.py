"""The figures of a loop and their limits: their formulas (the paper's sections 4.1 and 4.3, Eq. 9) for a response, each
declared in one place.

A new figure is one line of `LoopFigures`: JSON and its schema, terminal, page, DataFrame and reference follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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


class Ran(NamedTuple):
    """A response, shape (..., K), or one tick of it."""

    share: Any  # position, share of the travel
    duty: Any  # share of the supply
    current: Any  # A


class Demand(NamedTuple):
    """What is judged at each tick of a setpoint, shape (K,), or at one tick. Weights are 0 where nothing is judged."""

    wanted: Any  # setpoint, share of the travel
    level: Any  # level that holds, share of the travel
    overshot: Any  # % for a share of the travel beyond the level; negative where the level lies below the one before
    held: Any  # % for a share of the travel off the level, in its last quarter
    band: Any  # distance from the level within which it is settled; infinite outside every level
    after: Any  # s, from the change to the next tick; infinite at the last tick of a level
    tracked: Any  # 1 / ticks of the stretch
    tracked_ends: Any  # whether a stretch ends here
    tail: Any  # 1 / (ticks of the level's last quarter)
    tail_begins: Any  # whether that quarter begins here
    tail_ends: Any  # 1 / number of levels where it ends
    effort: Any  # 1 / ticks from the first change on

    @classmethod
    def of_setpoint(
        cls, setpoint: Setpoint, time: np.ndarray, levels: Sequence[Level], stretches: Sequence[Stretch]
    ) -> Demand:
        """Args: setpoint; time: s, shape (K,); levels, stretches: those that are judged, none within another."""
        at = cls(*np.zeros((len(cls._fields), time.size)))
        at.wanted[:], at.band[:] = setpoint.at(time), np.inf
        for level in levels:
            begin, end, size = *_ticks(time, level), abs(level.change)
            if begin == end:
                continue
            tail = min(begin + round((1.0 - TAIL) * (end - begin)), end - 1)
            at.level[begin:end] = level.after
            at.overshot[begin:end] = 100.0 * np.sign(level.change) / max(size, LEAST_OVERSHOT)
            at.held[tail:end] = 100.0 / max(size, LEAST_HELD)
            at.band[begin:end] = max(SETTLED * size, NEGLIGIBLE)
            at.after[begin:end] = np.append(time[begin + 1 : end] - level.begins, np.inf)
            at.tail[tail:end] = 1.0 / (end - tail)
            at.tail_begins[tail], at.tail_ends[end - 1] = 1.0, 1.0 / len(levels)
        for stretch in stretches:
            begin, end = _ticks(time, stretch)
            if begin < end:
                at.tracked[begin:end], at.tracked_ends[end - 1] = 1.0 / (end - begin), 1.0
        begin = _tick(time, min(part.begins for part in (*setpoint.levels, *setpoint.stretches)))
        at.effort[begin:] = 1.0 / (time.size - begin)
        return at


def _ticks(time: np.ndarray, part: Level | Stretch) -> tuple[int, int]:
    return _tick(time, part.begins), _tick(time, part.ends)


def _tick(time: np.ndarray, instant: float) -> int:
    """First tick at or after an instant (s)."""
    return int(np.searchsorted(time, instant - 0.5 * (time[1] - time[0])))


# the formulas: xp is NumPy for a whole response and JAX for a tick, from which a loop's kernel is made


def overshoot(xp: Any, at: Demand, ran: Ran) -> Any:
    """%, of the change."""
    return xp.where(at.overshot != 0.0, at.overshot * (ran.share - at.level), 0.0)


def settling(xp: Any, at: Demand, ran: Ran) -> Any:
    """s, until the first tick after the last one outside."""
    return xp.where(xp.abs(ran.share - at.level) > at.band, at.after, 0.0)


def steady_state_error(xp: Any, at: Demand, ran: Ran) -> Any:
    """%, of the change."""
    return xp.where(at.held > 0.0, at.held * xp.abs(ran.share - at.level), 0.0)


def tracking_error(xp: Any, at: Demand, ran: Ran) -> Any:
    """Square of %, of the travel (Eq. 9)."""
    return xp.where(at.tracked > 0.0, at.tracked * xp.square(100.0 * (ran.share - at.wanted)), 0.0)


def duty_activity(xp: Any, at: Demand, ran: Ran) -> Any:
    """%."""
    return 100.0 * ran.duty


def current_rms(xp: Any, at: Demand, ran: Ran) -> Any:
    """Square of A."""
    return xp.where(at.effort > 0.0, at.effort * xp.square(ran.current), 0.0)


class Reduction(NamedTuple):
    """The way from a formula's values at the ticks to one figure: of all ticks together, or tick by tick."""

    of_all: Callable[[np.ndarray, Demand], np.ndarray]  # values, shape (..., K) -> (...)
    begin: tuple[float, ...]  # before the first tick; the figure is the first number after the last one
    add: Callable[[Any, tuple[Any, ...], Any, Demand], tuple[Any, ...]]  # xp, numbers before, value, tick -> after
    root: bool = False  # whether the figure is the square root of that


def _largest(values: np.ndarray, at: Demand) -> np.ndarray:
    return np.maximum(np.max(values, axis=-1), 0.0)


def _add_largest(xp: Any, before: tuple[Any, ...], value: Any, at: Demand) -> tuple[Any, ...]:
    return (xp.maximum(before[0], value),)


def _sum(values: np.ndarray, at: Demand) -> np.ndarray:
    return np.sum(values, axis=-1)


def _add_sum(xp: Any, before: tuple[Any, ...], value: Any, at: Demand) -> tuple[Any, ...]:
    return (before[0] + value,)


def _worst_stretch(values: np.ndarray, at: Demand) -> np.ndarray:
    begins = np.append(0, np.flatnonzero(at.tracked_ends)[:-1] + 1)
    return np.max(np.add.reduceat(values, begins, axis=-1), axis=-1)


def _add_stretch(xp: Any, before: tuple[Any, ...], value: Any, at: Demand) -> tuple[Any, ...]:
    worst, total = before[0], before[1] + value
    ends = at.tracked_ends > 0.0
    return xp.where(ends, xp.maximum(worst, total), worst), xp.where(ends, 0.0, total)


def _variance(values: np.ndarray, at: Demand) -> np.ndarray:
    tails = zip(np.flatnonzero(at.tail_begins), np.flatnonzero(at.tail_ends) + 1, strict=True)
    each = [np.var(values[..., begin:end], axis=-1) for begin, end in tails]
    return np.mean(each, axis=0) if each else np.zeros(values.shape[:-1])


def _add_variance(xp: Any, before: tuple[Any, ...], value: Any, at: Demand) -> tuple[Any, ...]:
    """The sums are of what is left of a tail's first value: the variance of a constant is 0."""
    every, first, mean, square = before
    first = xp.where(at.tail_begins > 0.0, value, first)
    off = xp.where(at.tail > 0.0, value - first, 0.0)
    mean, square = mean + at.tail * off, square + at.tail * xp.square(off)
    ends = at.tail_ends > 0.0
    more = xp.where(ends, every + at.tail_ends * xp.maximum(square - xp.square(mean), 0.0), every)
    return more, first, xp.where(ends, 0.0, mean), xp.where(ends, 0.0, square)


Same = TypeVar("Same", bound="LoopFigures")


class By(Enum):
    """The data from which a figure is computed."""

    LEVEL = "the response at each level, the worst of them"
    STRETCH = "the response over each stretch, the worst of them"
    TAIL = "the duty in the last quarter of a level, all of them"
    RUN = "the whole response"
    HEAT = "current (rms, A), resistances of winding and bridge (ohm) -> W"
    MARGIN = "the linear loop; more is better"


REDUCTIONS = {
    By.LEVEL: Reduction(_largest, (0.0,), _add_largest),
    By.STRETCH: Reduction(_worst_stretch, (0.0, 0.0), _add_stretch, root=True),
    By.TAIL: Reduction(_variance, (0.0,) * 4, _add_variance, root=True),
    By.RUN: Reduction(_sum, (0.0,), _add_sum, root=True),
}


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
        "square of all levels.", "duty", limit=ACTIVITY.limit, by=By.TAIL, formula=duty_activity)  # fmt: skip
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

    def of_gains(self: Same, k: int) -> Same:
        """The figures of one of the gains, from figures of shape (D, G)."""
        return self.each(lambda figure: figure[:, k])

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
EFFORT = symbols_by(By.TAIL, By.RUN, By.HEAT)
REQUIRED = (*TRACKING, *EFFORT)
BY_RESPONSE = symbols_by(*REDUCTIONS)
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

    def all_met(self, figures: LoopFigures) -> np.ndarray:
        """Whether everything is met with a stable loop, entry by entry."""
        return np.all(list(self.met(figures).values()), axis=0) & (figures.gain_margin_db > 0.0)


def judge(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> LoopFigures:
    """The figures of a response: each is the worst of all levels, or of all stretches.

    Args:
        time: s, shape (K,), from 0 with an even step.
        share: position, share of the travel, shape (..., K); a value that is not finite counts as an infinite error.
    """
    ran = Ran(_infinite_where_none(share), None, None)
    return _known(TRACKING, setpoint, time, ran, setpoint.levels, setpoint.stretches)


def judge_all(setpoint: Setpoint, time: np.ndarray, ran: Ran) -> LoopFigures:
    """The same, and the figures of the effort but heat."""
    ran = ran._replace(share=_infinite_where_none(ran.share))
    return _known(BY_RESPONSE, setpoint, time, ran, setpoint.levels, setpoint.stretches)


def _infinite_where_none(share: np.ndarray) -> np.ndarray:
    """The values, infinite where they are not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.sum(share)  # a pass without an array of its own
    return share if np.isfinite(total) else np.where(np.isfinite(share), share, np.inf)


def judge_each(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> dict[str, LoopFigures]:
    """The figures of each scenario, with the tracking error over the whole scenario.

    A log has no levels: only its tracking error is known, and its other figures are NaN.
    """
    ran, out = Ran(_infinite_where_none(share), None, None), {}
    for name in setpoint.scenarios:
        levels = setpoint.only(name)
        parts = [part for part in (*levels, *setpoint.stretches) if part.scenario == name]
        whole = Stretch(min(part.begins for part in parts), max(part.ends for part in parts))
        out[name] = _known(TRACKING, setpoint, time, ran, levels, (whole,))
    return out


def _known(
    symbols: Sequence[str],
    setpoint: Setpoint,
    time: np.ndarray,
    ran: Ran,
    levels: Sequence[Level],
    stretches: Sequence[Stretch],
) -> LoopFigures:
    at = Demand.of_setpoint(setpoint, time, levels, stretches)

    def figure_of(symbol: str) -> np.ndarray:
        by, formula = FIGURES[symbol].how["by"], FIGURES[symbol].how["formula"]
        with np.errstate(invalid="ignore", over="ignore"):
            return _read(by, REDUCTIONS[by].of_all(formula(np, at, ran), at), levels)

    return LoopFigures(**{symbol: figure_of(symbol) for symbol in symbols})


Tally = dict[str, tuple[Any, ...]]  # numbers of each reduction between ticks, by figure


def tally() -> Tally:
    """The numbers before the first tick."""
    return {symbol: REDUCTIONS[FIGURES[symbol].how["by"]].begin for symbol in BY_RESPONSE}


def add_to_tally(xp: Any, before: Tally, at: Demand, ran: Ran) -> Tally:
    """The numbers after a tick."""
    ran = ran._replace(share=xp.where(xp.isfinite(ran.share), ran.share, np.inf))
    how = {symbol: FIGURES[symbol].how for symbol in before}
    return {symbol: REDUCTIONS[how[symbol]["by"]].add(xp, numbers, how[symbol]["formula"](xp, at, ran), at)
            for symbol, numbers in before.items()}  # fmt: skip


def of_tally(after: Tally, setpoint: Setpoint) -> LoopFigures:
    """The figures of `judge_all`, from the numbers after the last tick of a setpoint."""
    return LoopFigures(**{symbol: _read(FIGURES[symbol].how["by"], found, setpoint.levels)
                          for symbol, (found, *_) in after.items()})  # fmt: skip


def _read(by: By, found: np.ndarray, levels: Sequence[Level]) -> np.ndarray:
    """A figure from what its reduction found; NaN where there is no level to judge."""
    if by in (By.LEVEL, By.TAIL) and not levels:
        return np.full_like(found, np.nan)
    return np.sqrt(found) if REDUCTIONS[by].root else found


def with_heat(figures: LoopFigures, winding: Any, bridge: float) -> LoopFigures:
    """The figures with the heat of the current in the resistances of winding and bridge (ohm)."""
    current = figures.current_rms_A
    return replace(
        figures, **{symbol: FIGURES[symbol].how["formula"](current, winding, bridge) for symbol in symbols_by(By.HEAT)}
    )
