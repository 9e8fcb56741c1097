"""The settings of `fleet` that a user may change; other thresholds are constants of the files that use them."""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole


@dataclass(frozen=True)
class PopulationSettings:
    """How the mean and the spread between units are estimated.

    Args:
        level: coverage that every interval of the population states.
        uncorrelated: how many uncorrelated units' worth the prior of the correlations weighs, for each symbol that
            differs between units; 0 for none, so that a dozen units of a dozen symbols have correlations of +-1.
        wald: relative standard error of a standard deviation above which its interval is profiled.
    """

    level: float = real(0.95, above=0.0, below=1.0)
    uncorrelated: float = real(1.0, 0.0, 1000.0)
    wald: float = real(0.05, 0.0, 10.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class FleetSettings:
    """All that the statistics of a fleet decide by.

    Args:
        population: mean and spread between units.
        odd_rate: of false ones among the odd units found (Benjamini and Hochberg). In a healthy fleet it is the chance
            of any: so low that tails heavier than the scaled null still leave less than 1 % of the units.
        effect_rate: of units falsely said to have an effect, among those said to have it.
        drift_level: p value, multiplicity over symbols and kinds included, up to which a drift is reported.
    """

    population: PopulationSettings = PopulationSettings()
    odd_rate: float = real(0.01, above=0.0, below=1.0)
    effect_rate: float = real(0.01, above=0.0, below=1.0)
    drift_level: float = real(0.01, above=0.0, below=1.0)

    __post_init__ = check_ranges


DEFAULT = FleetSettings()


@dataclass(frozen=True)
class EngineSettings:
    """When a unit is given up, and in which portions units are handed out.

    Args:
        tries: workers on which a unit is tried whose worker dies, or whose worker has no room left; then it has failed.
        time_limit: s that one unit may take.
        grace: s after which a unit that cannot be stopped at its time limit costs its worker process.
        portion: s of work that one task holds, so that tiny units share the price of a task.
    """

    tries: int = whole(2, 1, 10)
    time_limit: float = real(900.0, above=0.0, high=1e6)
    grace: float = real(30.0, above=0.0, high=1e5)
    portion: float = real(0.3, above=0.0, high=60.0)

    __post_init__ = check_ranges
