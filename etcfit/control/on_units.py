"""How one set of gains fares on many units: of a fleet, of the parts of a design, and on units not made yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .loop_figures import REQUIRED, LoopFigures, Requirements
from .settings import FleetDesignSettings

STABLE = "stable"  # what a unit whose linear loop is not stable misses
NAMED = 10  # worst units that are named
_LEVEL = 0.95


class Share(NamedTuple):
    """Share of the units that meet everything."""

    met: int  # how many
    of: int  # how many there are
    # low, high: 95 % interval of the share in the population that they come from, exact for independent units (Clopper
    # and Pearson 1934, Biometrika 26)
    low: float
    high: float

    @property
    def value(self) -> float:
        return self.met / self.of

    @classmethod
    def counted(cls, met: np.ndarray) -> Share:
        """Share of the units that meet everything, from truth values, shape (U,)."""
        from scipy.stats import binomtest

        count = int(np.sum(met))
        ends = binomtest(count, met.size).proportion_ci(_LEVEL, "exact")
        return cls(count, met.size, float(ends.low), float(ends.high))


class OddOne(NamedTuple):
    """A unit that fares badly."""

    unit: str  # its name
    requirement: str  # the one that it misses by most, or meets most narrowly
    # figure, limit: of it; of a stable loop its gain margin (dB) and 0
    figure: float
    limit: float
    meets: bool  # whether it meets everything all the same


@dataclass(frozen=True, eq=False)
class OneByOne:
    """Figures of gains on many units."""

    units: tuple[str, ...]  # names, U of them
    figures: LoopFigures  # of each unit, shape (U,)
    asked: Requirements  # requirements

    def taking(self, which: np.ndarray) -> OneByOne:
        """Some of the units, by their numbers, shape (C,)."""
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
        return Share.counted(self.met)

    @property
    def fails(self) -> dict[str, tuple[str, ...]]:
        """Units that miss each requirement, by its name, "stable" among them; those that none misses are left out."""
        names = np.array(self.units, dtype=object)
        return {symbol: tuple(names[missed].tolist()) for symbol, missed in self.missed.items() if missed.any()}

    def named(self, count: int) -> tuple[OddOne, ...]:
        """So many units at most, the worst first."""
        return tuple(self._odd(int(k)) for k in self.worst_first[:count])

    def _odd(self, k: int) -> OddOne:
        if not (margin := float(self.figures.gain_margin_db[k])) > 0.0:
            return OddOne(self.units[k], STABLE, margin, 0.0, False)
        symbol = REQUIRED[int(np.argmax(self.strain[:, k]))]
        figure, limit = float(getattr(self.figures, symbol)[k]), float(getattr(self.asked, symbol))
        return OddOne(self.units[k], symbol, figure, limit, bool(self.met[k]))


@dataclass(frozen=True, eq=False)
class FleetVerdict:
    """Whether gains meet everything on enough units."""

    settings: FleetDesignSettings  # share of the units that must, and how gains for them were searched
    own: OneByOne  # the gains on each unit of the fleet
    # units drawn from the population, none of which the search has seen; None where the fleet is too small to say how
    # its units scatter
    future: Share | None
    searches: int  # made until these gains were found

    @property
    def share(self) -> Share:
        return self.own.share

    @property
    def worst(self) -> tuple[OddOne, ...]:
        return self.own.named(NAMED)

    @property
    def fails(self) -> Mapping[str, tuple[str, ...]]:
        return self.own.fails

    @property
    def share_asked(self) -> float:
        """Share of the units that must meet everything."""
        return self.settings.share

    @property
    def reached(self) -> bool:
        return self.share.value >= self.share_asked

    @property
    def says(self) -> str:
        """The verdict in a sentence."""
        s = self.share
        met = f"{s.met} of {s.of} units meet everything"
        if self.reached:
            return f"{met}: the {self.share_asked:.0%} asked for are reached"
        return f"{met}: FEWER than the {self.share_asked:.0%} asked for; no gains were found that reach more"


class OnParts(NamedTuple):
    """One set of gains on each measured unit of a fleet, and on units drawn from its population."""

    measured: OneByOne
    drawn: OneByOne

    @property
    def worst(self) -> OddOne:
        """The measured unit that fares worst."""
        return self.measured.named(1)[0]


@dataclass(frozen=True, eq=False)
class PartsVerdict:
    """Gains of every rule on the parts of a design, at the bench and, those that are proposed, outside it."""

    # where, name: of the fleet, see `fleet.Parts`
    where: str
    name: str
    of_run: tuple[str, ...]  # parameters that the fleet does not tell, taken from the run
    left_out: Mapping[str, str]  # units that are none of the parts, with why
    rules: Mapping[str, OnParts]  # by name, those that have gains
    # the proposed gains on each measured unit at each corner of supply, winding and friction, unit by unit
    corners: OneByOne
    anywhere: OneByOne  # the proposed gains on the drawn units, each under conditions drawn for it

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the measured ones."""
        return next(iter(self.rules.values())).measured.units

    @property
    def share_at_corners(self) -> Share:
        """Share of the measured units that meet everything at every corner."""
        return Share.counted(np.all(self.corners.met.reshape(len(self.units), -1), axis=1))
