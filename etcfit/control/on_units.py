"""Results of one set of gains on many units: those of a fleet, the parts of a design, and future units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .loop_figures import REQUIRED, LoopFigures, Requirements
from .settings import FleetDesignSettings

STABLE = "stable"  # the requirement that a unit with an unstable linear loop misses
NAMED = 10  # most units that are named, the worst first
_LEVEL = 0.95


class Share(NamedTuple):
    """Share of the units that meet every requirement."""

    met: int  # number of units that do
    of: int  # number of all units
    # low, high: 95 % interval of the share in the population that they come from, exact for independent units (Clopper
    # and Pearson 1934, Biometrika 26)
    low: float
    high: float

    @property
    def value(self) -> float:
        return self.met / self.of

    @classmethod
    def counted(cls, met: np.ndarray) -> Share:
        """The share, from truth values of the units, shape (U,)."""
        from scipy.stats import binomtest

        count = int(np.sum(met))
        ends = binomtest(count, met.size).proportion_ci(_LEVEL, "exact")
        return cls(count, met.size, float(ends.low), float(ends.high))


class OddOne(NamedTuple):
    """One of the units with the worst results."""

    unit: str  # its name
    requirement: str  # the requirement that it misses by most, or meets most narrowly
    figure: float  # what it reaches of that requirement; for "stable" the gain margin, dB
    limit: float  # limit of that requirement; 0 for "stable"
    meets: bool  # whether it meets every requirement


@dataclass(frozen=True, eq=False)
class OneByOne:
    """Figures of gains on many units."""

    units: tuple[str, ...]  # names, U of them
    figures: LoopFigures  # of each unit, shape (U,)
    requirements: Requirements  # the limits

    def taking(self, which: np.ndarray) -> OneByOne:
        """The results of some of the units, by their numbers, shape (C,)."""
        units = tuple(self.units[k] for k in which.tolist())
        return replace(self, units=units, figures=self.figures.each(lambda figure: figure[which]))

    @property
    def missed(self) -> dict[str, np.ndarray]:
        """Whether each unit misses each requirement, including stability, shape (U,)."""
        over = {symbol: ~met for symbol, met in self.requirements.met(self.figures).items()}
        return over | {STABLE: ~(self.figures.gain_margin_db > 0.0)}

    @property
    def met(self) -> np.ndarray:
        """Whether each unit meets every requirement with a stable loop, shape (U,)."""
        return ~np.any(list(self.missed.values()), axis=0)

    @property
    def strain(self) -> np.ndarray:
        """Each figure over its limit, infinite where the loop is unstable, shape (R, U) in the order of REQUIRED."""
        over = np.stack(list(self.requirements.strain(self.figures).values()))
        stable = (self.figures.gain_margin_db > 0.0)[None]
        return np.where(stable, np.nan_to_num(over, nan=np.inf, posinf=np.inf), np.inf)

    @property
    def worst_first(self) -> np.ndarray:
        """Numbers of the units, the worst first, shape (U,)."""
        return np.argsort(-np.max(self.strain, axis=0), kind="stable")

    @property
    def share(self) -> Share:
        return Share.counted(self.met)

    @property
    def fails(self) -> dict[str, tuple[str, ...]]:
        """The units that miss each requirement, by its name, including "stable"; without requirements that all meet."""
        names = np.array(self.units, dtype=object)
        return {symbol: tuple(names[missed].tolist()) for symbol, missed in self.missed.items() if missed.any()}

    def named(self, count: int) -> tuple[OddOne, ...]:
        """The worst units, `count` at most, the worst first."""
        return tuple(self._odd(int(k)) for k in self.worst_first[:count])

    def _odd(self, k: int) -> OddOne:
        if not (margin := float(self.figures.gain_margin_db[k])) > 0.0:
            return OddOne(self.units[k], STABLE, margin, 0.0, False)
        symbol = REQUIRED[int(np.argmax(self.strain[:, k]))]
        figure, limit = float(getattr(self.figures, symbol)[k]), float(getattr(self.requirements, symbol))
        return OddOne(self.units[k], symbol, figure, limit, bool(self.met[k]))


@dataclass(frozen=True, eq=False)
class FleetVerdict:
    """Whether gains meet every requirement on enough units."""

    settings: FleetDesignSettings  # required share of the units, and settings of the search
    own: OneByOne  # the results on each unit of the fleet
    # share among units drawn from the population that the search did not use; None where the fleet is too small to
    # estimate the scatter of its units
    future: Share | None
    searches: int  # number of searches until these gains were found

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
        """Share of the units that must meet every requirement."""
        return self.settings.share

    @property
    def reached(self) -> bool:
        return self.share.value >= self.share_asked

    @property
    def says(self) -> str:
        """The verdict in a sentence."""
        s = self.share
        met = f"{s.met} of {s.of} units meet every requirement"
        if self.reached:
            return f"{met}: the required {self.share_asked:.0%} are reached"
        return f"{met}: FEWER than the required {self.share_asked:.0%}; no gains were found that reach more"


class OnParts(NamedTuple):
    """Results of one set of gains on each measured unit of a fleet, and on units drawn from its population."""

    measured: OneByOne
    drawn: OneByOne

    @property
    def worst(self) -> OddOne:
        """The measured unit with the worst result."""
        return self.measured.named(1)[0]


@dataclass(frozen=True, eq=False)
class PartsVerdict:
    """Results of every rule's gains on the parts of a design at the bench, and of the proposed gains outside it too."""

    # where, name: of the fleet, see `fleet.Parts`
    where: str
    name: str
    of_run: tuple[str, ...]  # parameters that the fleet does not determine, taken from the run
    left_out: Mapping[str, str]  # units that are left out, with the reason
    rules: Mapping[str, OnParts]  # results by rule, for rules that have gains
    # results of the proposed gains on each measured unit at each corner of supply, winding and friction, unit by unit
    corners: OneByOne
    anywhere: OneByOne  # results of the proposed gains on the drawn units, each under random conditions

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the measured units."""
        return next(iter(self.rules.values())).measured.units

    @property
    def share_at_corners(self) -> Share:
        """Share of the measured units that meet every requirement at every corner."""
        return Share.counted(np.all(self.corners.met.reshape(len(self.units), -1), axis=1))
