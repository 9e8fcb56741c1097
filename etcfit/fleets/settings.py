"""The settings of `fleet` that a user may change; other thresholds are constants of the files that use them."""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole


@dataclass(frozen=True)
class PopulationSettings:
    """Settings of the estimate of mean and spread between units.

    Args:
        level: coverage that every interval of the population states.
        uncorrelated: weight of the prior of the correlations, as a number of uncorrelated units for each symbol that
            differs between units; 0: no prior, so that a dozen units of a dozen symbols have correlations of +-1.
        wald: relative standard error of a standard deviation above which its interval is profiled.
    """

    level: float = real(0.95, above=0.0, below=1.0)
    uncorrelated: float = real(1.0, 0.0, 1000.0)
    wald: float = real(0.05, 0.0, 10.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class FleetSettings:
    """Settings of the statistics of a fleet.

    Args:
        population: mean and spread between units.
        odd_rate: rate of false ones among the odd units found (Benjamini and Hochberg). In a healthy fleet it is the
            chance of finding any; it is so low that, even with tails heavier than the scaled null, fewer than 1 % of
            the units are found.
        effect_rate: rate of units that falsely have an effect, among those reported to have it.
        drift_level: p value, corrected for the number of symbols and kinds, up to which a drift is reported.
    """

    population: PopulationSettings = PopulationSettings()
    odd_rate: float = real(0.01, above=0.0, below=1.0)
    effect_rate: float = real(0.01, above=0.0, below=1.0)
    drift_level: float = real(0.01, above=0.0, below=1.0)

    __post_init__ = check_ranges


DEFAULT = FleetSettings()


@dataclass(frozen=True)
class EngineSettings:
    """Limits after which a unit is given up, and the portions in which units are handed out.

    Args:
        tries: number of workers on which a unit is tried where its worker dies or has no memory or disk left; then the
            unit has failed.
        time_limit: time that one unit may take, s.
        grace: time after the limit until a unit that cannot be stopped ends its worker process, s.
        portion: work in one task, s, so that tiny units share the cost of a task.
    """

    tries: int = whole(2, 1, 10)
    time_limit: float = real(900.0, above=0.0, high=1e6)
    grace: float = real(30.0, above=0.0, high=1e5)
    portion: float = real(0.3, above=0.0, high=60.0)

    __post_init__ = check_ranges
