"""How one set of gains fares on every unit of a fleet, and on units that are not made yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .pid.figures import REQUIRED, LoopFigures, Requirements
from .settings import FleetDesignSettings

STABLE = "stable"  # what a unit whose linear loop is not stable misses
_LEVEL = 0.95


class Share(NamedTuple):
    """Of units that meet everything.

    Args:
        met: how many.
        of: how many there are.
        low, high: 95 % interval of the share in the population that they come from, exact for independent units
            (Clopper and Pearson 1934, Biometrika 26).
    """

    met: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share itself."""
        return self.met / self.of

    @classmethod
    def counted(cls, met: np.ndarray) -> Share:
        """Of truth values, shape (U,)."""
        from scipy.stats import binomtest

        count = int(np.sum(met))
        ends = binomtest(count, met.size).proportion_ci(_LEVEL, "exact")
        return cls(count, met.size, float(ends.low), float(ends.high))


class OddOne(NamedTuple):
    """A unit that fares badly.

    Args:
        unit: its name.
        requirement: the one that it misses by most, or meets most narrowly.
        figure, limit: of it; of a stable loop its gain margin (dB) and 0.
        meets: whether it meets everything all the same.
    """

    unit: str
    requirement: str
    figure: float
    limit: float
    meets: bool


@dataclass(frozen=True, eq=False)
class OneByOne:
    """Figures of gains on many units.

    Args:
        units: names, U of them.
        figures: of each unit, shape (U,).
        asked: of them.
    """

    units: tuple[str, ...]
    figures: LoopFigures
    asked: Requirements

    def taking(self, which: np.ndarray) -> OneByOne:
        """Of some of the units, by their numbers, shape (C,)."""
        units = tuple(self.units[k] for k in which.tolist())
        return replace(self, units=units, figures=self.figures.each(lambda figure: figure[which]))

    @property
    def missed(self) -> dict[str, np.ndarray]:
        """Whether each unit misses each requirement, stability among them, shape (U,)."""
        over = {symbol: ~met for symbol, met in self.asked.met(self.figures).items()}
        return over | {STABLE: ~(self.figures.gain_margin_db > 0.0)}

    @property
    def met(self) -> np.ndarray:
        """Every requirement, by a stable loop, shape (U,)."""
        return ~np.any(list(self.missed.values()), axis=0)

    @property
    def strain(self) -> np.ndarray:
        """Each figure over its limit, infinite where the loop is unstable, shape (R, U) in the order of REQUIRED."""
        over = np.stack(list(self.asked.strain(self.figures).values()))
        stable = (self.figures.gain_margin_db > 0.0)[None]
        return np.where(stable, np.nan_to_num(over, nan=np.inf, posinf=np.inf), np.inf)

    @property
    def worst_first(self) -> np.ndarray:
        """Numbers of the units, shape (U,)."""
        return np.argsort(-np.max(self.strain, axis=0), kind="stable")

    @property
    def share(self) -> Share:
        """Of the units that meet everything."""
        return Share.counted(self.met)

    @property
    def fails(self) -> dict[str, tuple[str, ...]]:
        """Units that miss each requirement, by its name, "stable" among them; those that none misses are left out."""
        names = np.array(self.units, dtype=object)
        return {symbol: tuple(names[missed].tolist()) for symbol, missed in self.missed.items() if missed.any()}

    def named(self, count: int) -> tuple[OddOne, ...]:
        """So many units at most, the worst first."""
        return tuple(_odd(self, int(k)) for k in self.worst_first[:count])


@dataclass(frozen=True, eq=False)
class FleetVerdict:
    """Whether gains meet everything on enough units.

    Args:
        settings: share of the units that must, and how gains for them were searched.
        share: of the units of the fleet that do.
        future: of units drawn from the population, none of which the search has seen; None where the fleet is too
            small to say how its units scatter.
        worst: units, the worst first.
        fails: units that miss each requirement, by its name, "stable" among them; those that none misses are left out.
        searches: made until these gains were found.
    """

    settings: FleetDesignSettings
    share: Share
    future: Share | None
    worst: tuple[OddOne, ...]
    fails: Mapping[str, tuple[str, ...]]
    searches: int

    @property
    def asked(self) -> float:
        """Share of the units that must meet everything."""
        return self.settings.share

    @property
    def reached(self) -> bool:
        """Whether enough units of the fleet meet everything."""
        return self.share.value >= self.asked

    @property
    def says(self) -> str:
        """In a sentence."""
        s = self.share
        met = f"{s.met} of {s.of} units meet everything"
        if self.reached:
            return f"{met}: the {self.asked:.0%} asked for are reached"
        return f"{met}: FEWER than the {self.asked:.0%} asked for; no gains were found that reach more"


def verdict(found: OneByOne, future: OneByOne | None, settings: FleetDesignSettings, searches: int) -> FleetVerdict:
    """What figures unit by unit come to.

    Args:
        found: of the fleet's own units.
        future: of drawn ones, or None.
        settings: share of the units that must meet everything, and how many are named.
        searches: made.
    """
    ahead = None if future is None else future.share
    return FleetVerdict(settings, found.share, ahead, found.named(settings.named), found.fails, searches)


def _odd(found: OneByOne, k: int) -> OddOne:
    if not (margin := float(found.figures.gain_margin_db[k])) > 0.0:
        return OddOne(found.units[k], STABLE, margin, 0.0, False)
    symbol = REQUIRED[int(np.argmax(found.strain[:, k]))]
    limit = float(getattr(found.asked, symbol))
    return OddOne(found.units[k], symbol, float(getattr(found.figures, symbol)[k]), limit, bool(found.met[k]))
