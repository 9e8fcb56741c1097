"""What the statistics of a fleet decide by: every level, rate and threshold of them, with default and allowed range."""

from __future__ import annotations

from dataclasses import dataclass

from ...ranges import check_ranges, real, whole


@dataclass(frozen=True)
class PopulationSettings:
    """How the mean and the spread between units are estimated.

    Args:
        level: coverage that every interval of the population states.
        uncorrelated: how many uncorrelated units' worth the prior of the correlations weighs, for each symbol that
            differs between units; 0 for none, so that a dozen units of a dozen symbols have correlations of +-1.
        enough: units for each symbol that differs from which on all standard deviations are estimated together.
        steps: quasi-Newton steps at most.
        tolerance: fall of minus twice the log likelihood still promised that ends them.
        wald: relative standard error of a standard deviation above which its interval is profiled.
        rounds: times at most that units are left out or taken back, and the population is estimated again.
        fewest: share of the units that stays in the population, whatever the others are like.
        null: share of a unit's largest eigenvalue of information (scaled) below which a direction has none.
    """

    level: float = real(0.95, above=0.0, below=1.0)
    uncorrelated: float = real(1.0, 0.0, 1000.0)
    enough: float = real(4.0, 0.0, 1e6)
    steps: int = whole(200, 1, 100_000)
    tolerance: float = real(1e-6, above=0.0, high=1.0)
    wald: float = real(0.05, 0.0, 10.0)
    rounds: int = whole(10, 1, 1000)
    fewest: float = real(0.7, 0.5, 1.0)
    null: float = real(1e-11, 0.0, 1e-3)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class OddSettings:
    """When a unit counts as odd.

    Args:
        rate: of false ones among those found (Benjamini and Hochberg). In a healthy fleet it is the chance of any: so
            low that tails heavier than the scaled null still leave less than 1 % of the units.
        tail: quantile of the fleet's own scores that, beside the median, sets the scale of the null.
        least_scatter: of misfits, standard deviation of their logarithm: what differs by less is alike.
        named: score of a symbol or trace, standard deviations, from which on it is named.
        shown: symbols and traces that the one line names at most.
    """

    rate: float = real(0.01, above=0.0, below=1.0)
    tail: float = real(0.9, 0.55, 0.99)
    least_scatter: float = real(0.03, above=0.0, high=10.0)
    named: float = real(3.0, 0.0, 100.0)
    shown: int = whole(3, 1, 100)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class ChartSettings:
    """Control charts and drift.

    Args:
        width: of the control limits, standard deviations on either side.
        allowance: k of the CUSUM, standard deviations: half the shift that it is to find.
        decision: h of the CUSUM, standard deviations: with k = 0.5, 5 gives a false alarm every 470 units.
        level: p value, multiplicity over symbols and kinds included, up to which a drift is reported.
        clip: scores are clipped to so many standard deviations before a change is sought: odd units are no drift.
        fewest: units without which no drift is sought.
    """

    width: float = real(3.0, above=0.0, high=100.0)
    allowance: float = real(0.5, above=0.0, high=10.0)
    decision: float = real(5.0, above=0.0, high=1000.0)
    level: float = real(0.01, above=0.0, below=1.0)
    clip: float = real(3.0, 1.0, 100.0)
    fewest: int = whole(8, 4, 1_000_000)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class FleetSettings:
    """All that the statistics of a fleet decide by.

    Args:
        population: mean and spread between units.
        odd: units unlike the others.
        charts: control charts and drift.
        effect_rate: of units falsely said to have an effect, among those said to have it.
        most_widening: of a unit's standard errors by what its own traces say, times that of the fleet's middle unit,
            where it tells of the population: one unit that is too sure harms it.
        most_drawn: the same where the population tells of the unit: one that is not sure enough of itself is drawn to
            the mean and away from its own value.
    """

    population: PopulationSettings = PopulationSettings()
    odd: OddSettings = OddSettings()
    charts: ChartSettings = ChartSettings()
    effect_rate: float = real(0.01, above=0.0, below=1.0)
    most_widening: float = real(3.0, 1.0, 1e6)
    most_drawn: float = real(2.0, 1.0, 1e6)

    __post_init__ = check_ranges


DEFAULT = FleetSettings()
