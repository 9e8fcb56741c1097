"""Settings of a fit: thresholds, budgets and seeds, each with unit, default and allowed range.

Two terms return throughout:

    chi2: sum of squared residuals, each over its own standard deviation; about 1 per sample if the model is right.
    coordinate: the unbounded number that represents a parameter during the fit, the logarithm of a positive one; its
        reach is a change by about a hundred percent: 1 for a logarithm, else the larger of 1 and |x|.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, whole


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """Standard deviation above which a parameter, or a combination of parameters, counts as not known.

    There are two thresholds for one verdict, because there are two covariances. `unknown` applies to the one that
    assumes a right model. `unknown_widened` applies to the wider one that allows for correlated residuals: there a
    somewhat wider interval is still worth printing.

    Args:
        unknown: standard deviation over reach (about the relative error) above which a parameter or direction is "not
            identifiable", and a fitted gain of the ECU is not used by a design; dimensionless.
        unknown_widened: standard deviation over reach, or relative standard error of a combination, above which the
            widened covariance gives no interval but "not identifiable"; dimensionless.
    """

    unknown: float = real(0.3, 1e-6, 100.0)
    unknown_widened: float = real(0.5, 1e-6, 100.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class ContradictionSettings:
    """When traces and rig tests count as disagreeing, and parameters as a compromise between them.

    Args:
        level: probability that a rig test is named although none contradicts the others.
        understated: factor by which errors may exceed their standard errors before tests count as contradicting.
            If few samples determine a parameter, such as those after an edge or an impact, errors are larger than
            stated (docs/validation/calibration.md); with a factor of 1, one clean folder in twenty had a contradicting
            test.
        moves: standard errors of noise alone by which the fit without a test must differ, in some combination of
            parameters, for that test to contradict the others. Below it the others outweigh the test: no result
            changes.
        compromise: chi2 per degree of freedom above which no parameter is called estimated.
    """

    level: float = real(1e-3, 0.0, 1.0)
    understated: float = real(1.5, 1.0, 100.0)
    moves: float = real(1.0, 0.0, 1e12)
    compromise: float = real(2.0, 0.0, 1e12)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class GlobalSearchSettings:
    """Budgets of the two searches without a gradient: a population far from the data, draws about a rough optimum.

    Args:
        points: members of the population, and points drawn at once.
        epochs: largest number of generations of the population.
        patience: number of generations over which chi2 must still fall.
        population_seed: seed of the population's random numbers.
        draws: largest number of times that points are drawn about a rough optimum.
        draws_seed: seed of the draws' random numbers.
    """

    points: int = whole(64, 4, 100_000)
    epochs: int = whole(120, 1, 100_000)
    patience: int = whole(25, 1, 100_000)
    population_seed: int = whole(11, 0, 2**32 - 1)
    draws: int = whole(100, 1, 100_000)
    draws_seed: int = whole(7, 0, 2**32 - 1)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class FitSettings:
    """The plan of a joint fit.

    Args:
        starts: number of starting points in addition to the reading of the paper's graphs.
        spread: standard deviation of the other starts about the first one, in reaches of each coordinate.
        seed: seed of the random numbers that scatter the starts.
        tolerance: relative change of chi2, and absolute change of the stretched coordinates, that ends a descent in the
            rounds.
        steps: largest number of Levenberg-Marquardt steps of one descent.
        misfit: chi2 per degree of freedom of the best start at or above which the model is "far" from the data: it
            lacks something, and the simulation is fitted free-running instead of through the whitening filter.
        rounds: largest number of renewals of the filter, the releases of the plate and the outliers.
        search: budgets of the searches without a gradient.
        neighbours: with an ECU in the model, number of points about the likeliest end from which the fit starts again
            in each search; 0: no search.
        identifiability: when a parameter counts as not known.
        contradiction: when traces and tests count as disagreeing.
    """

    starts: int = whole(3, 0, 1000)
    spread: float = real(0.35, 0.0, 10.0)
    seed: int = whole(20230701, 0, 2**32 - 1)
    tolerance: float = real(3e-6, 1e-15, 1.0)
    steps: int = whole(40, 1, 100_000)
    misfit: float = real(30.0, 0.0, 1e12)
    rounds: int = whole(10, 1, 1000)
    search: GlobalSearchSettings = GlobalSearchSettings()
    neighbours: int = whole(6, 0, 1000)
    identifiability: IdentifiabilitySettings = IdentifiabilitySettings()
    contradiction: ContradictionSettings = ContradictionSettings()

    __post_init__ = check_ranges
