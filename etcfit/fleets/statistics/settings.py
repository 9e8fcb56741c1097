"""What the statistics of a fleet decide by, as far as it may be set; other thresholds stand by their formulas."""

from __future__ import annotations

from dataclasses import dataclass

from ...ranges import check_ranges, real


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
