"""What a fit decides by: its thresholds, budgets and seeds, each with unit, default and allowed range.

Two terms return throughout:

    chi2: sum of squared residuals, each over its own standard deviation; about 1 a sample where the model is right.
    coordinate: the unbounded number that stands for a parameter during the fit, the logarithm of a positive one; its
        reach is what a change by about a hundred percent is in it: 1 for a logarithm, else the larger of 1 and |x|.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ranges import check_ranges, real, reals, whole


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """From which standard deviation on a parameter, or a combination of parameters, counts as not known.

    Two thresholds for one verdict, because two covariances are judged. `unknown` judges the one that assumes a right
    model. `unknown_widened` judges the wider one that allows for correlated residuals: there an interval is still
    worth printing a little longer.

    Args:
        unknown: standard deviation over reach (about the relative error) above which a parameter or direction is "not
            identifiable", and a fitted gain of the ECU is not used by a design; dimensionless.
        unknown_widened: standard deviation over reach, or relative standard error of a combination, above which the
            widened covariance gives no interval but "not identifiable"; dimensionless.
        weak: standard deviation over reach from which on a direction is reported as badly known; dimensionless.
        named_share: a symbol is named in a direction where its component is more than this share of the largest one.
    """

    unknown: float = real(0.3, 1e-6, 100.0)
    unknown_widened: float = real(0.5, 1e-6, 100.0)
    weak: float = real(0.1, 1e-6, 100.0)
    named_share: float = real(0.1, 0.0, 1.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class WhitenessSettings:
    """When residuals count as larger than their noise, or as correlated, so that intervals are widened.

    Args:
        lags: of the Ljung-Box test, samples; a trace shorter than 4 times as much is not tested.
        level: p-value of that test at or below which residuals are called correlated.
        excess: standard errors by which the mean square of the residuals must exceed 1 to be called larger than noise.
    """

    lags: int = whole(12, 1, 10_000)
    level: float = real(1e-4, 0.0, 1.0)
    excess: float = real(4.0, 0.0, 100.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class ContradictionSettings:
    """When traces and rig tests count as disagreeing, and parameters as a compromise between them.

    Args:
        scatter: p-value below which traces, or tests, scatter by more than their noise, so that intervals are widened.
        level: probability that a rig test is named although none contradicts the others.
        understated: times that errors may exceed their standard errors before tests are said to contradict each other.
            Where few samples tell a parameter, those after an edge or an impact, errors are larger than stated
            (docs/validation/calibration.md); as they are, one clean folder in twenty had a test that "contradicts".
        share: of the misfit that must be gone when a test may differ from the others, for it to be named.
        moves: standard errors of noise alone by which the fit without a test must differ, in some combination of
            parameters, for that test to contradict the others. Below it the others outweigh it: no result changes.
        named: tests that may be named, one after the other; where one is mended the next shows by itself.
        compromise: chi2 per degree of freedom from which on no parameter is called estimated.
    """

    scatter: float = real(0.05, 0.0, 1.0)
    level: float = real(1e-3, 0.0, 1.0)
    understated: float = real(1.5, 1.0, 100.0)
    share: float = real(0.5, 0.0, 1.0)
    moves: float = real(1.0, 0.0, 1e12)
    named: int = whole(1, 0, 100)
    compromise: float = real(2.0, 0.0, 1e12)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class GlobalSearchSettings:
    """Budgets of the two searches without a gradient: a population far from the data, draws about a rough optimum.

    Args:
        points: members of the population, and points drawn at once; a multiple of the number of `radii`.
        epochs: generations of the population at most.
        patience: generations over which chi2 must still fall.
        least_gain: share of chi2 by which it must fall over them, else the population stops.
        population_seed: of the random numbers of the population.
        draws: times that points are drawn about a rough optimum at most.
        radii: distances at which equal shares of the points are drawn, standard deviations of the fit.
        worth: fall of chi2, in units of chi2 per degree of freedom, that makes a move worth it.
        draws_seed: of the random numbers of the draws.
    """

    points: int = whole(64, 4, 100_000)
    epochs: int = whole(120, 1, 100_000)
    patience: int = whole(25, 1, 100_000)
    least_gain: float = real(0.01, 0.0, 1.0)
    population_seed: int = whole(11, 0, 2**32 - 1)
    draws: int = whole(100, 1, 100_000)
    radii: tuple[float, ...] = reals((1.0, 0.3, 0.1, 0.03), 0.0, 100.0)
    worth: float = real(0.02, 0.0, 1e6)
    draws_seed: int = whole(7, 0, 2**32 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.points % len(self.radii):
            raise ValueError(f"GlobalSearchSettings.points = {self.points}: it must be a multiple of the number of "
                             f"radii, {len(self.radii)}.")  # fmt: skip


@dataclass(frozen=True)
class GuideSettings:
    """How stiff the guide is that draws a plate along its measured angle, and how it is let go.

    Args:
        give: how far the guide gives way to a torque as large as dry friction, over the travel that was measured.
        bandwidth: by which its least stiffness is measured, Hz.
        bandwidth_of_rate: most that this bandwidth may be, over the sample rate.
        least: least stiffness over J w^2, w the bandwidth: for plates with hardly any dry friction.
        stable: most stiffness over that at which guide and coil would swing.
        shares: of the stiffness, one after the other, with which a model far from its data is led into its free run.
    """

    give: float = real(0.01, above=0.0, below=1.0)
    bandwidth: float = real(15.0, above=0.0)
    bandwidth_of_rate: float = real(0.1, above=0.0, below=1.0)
    least: float = real(0.003, above=0.0)
    stable: float = real(0.3, above=0.0, below=1.0)
    shares: tuple[float, ...] = reals((1.0, 0.3, 0.1, 0.03, 0.01, 0.003), 0.0, 1.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class FitSettings:
    """The plan of a joint fit.

    Args:
        starts: starting points besides the one that the paper's graphs give.
        spread: standard deviation of the other starts about the first one, in reaches of each coordinate.
        seed: of the random numbers that scatter the starts.
        late: by how much every sampling instant may be off, s, in one descent after the other: a simulated plate that
            meets its stop a little early is forgiven at first, and less and less.
        rough_tolerance: a descent from a start ends where neither chi2 (relative) nor any stretched coordinate
            (absolute) changes by more.
        tolerance: relative change of chi2, and absolute one of the stretched coordinates, that ends a descent in the
            rounds.
        steps: Levenberg-Marquardt steps of one descent at most.
        misfit: chi2 per degree of freedom of the best start. At or above it the model is "far" from the data: it lacks
            something, and the simulation is fitted free-running instead of through the whitening filter.
        rounds: times that the filter, the releases of the plate and the outliers are renewed at most.
        clock_rounds: of them, those in which the jitter of the sampling instants is estimated as well. Later rounds
            linearise half way between the last two optima: an impact that crosses a sampling instant would otherwise
            make two optima alternate.
        off_bound_rounds: first rounds whose descents begin moved off the bounds of the parameters.
        settled: a round that moves no parameter by more is the last, standard errors.
        alternating: a last round that moves a parameter by more than this is reported to alternate, standard errors.
        wandering: a last round that moves one by more is no optimum: the fit has not converged, standard errors.
        decrement: chi2 that the gradient still promises, in units of chi2 per degree of freedom, above which the end of
            the rounds is searched about for a deeper one.
        rough: largest fall of chi2, in units of chi2 per degree of freedom, that the last draws of such a search may
            find if the fit is to count as converged.
        reweighings: times that each channel's weight is renewed from the error left in it, for a model that is far.
        guide: of a model that is far, the way from its measured path into its free run.
        search: budgets of the searches without a gradient.
        neighbours: where an ECU is in the model, points about the likeliest end from which the fit is begun again at a
            time; with 0 it is not begun again.
        neighbourhood: standard deviations of those points about that end, reaches of each coordinate, in turn.
        first_rounds: rounds from each of them at first.
        nearly_settled: what counts as not moving there, as `settled`: ends that alternate by less are as good as one.
        hopeful: -2 log L above the least from which on an end is given up after those.
        searches: times that so many points are drawn at most; each further time about a likelier end.
        likelier: fall of -2 log L that makes it worth drawing again.
        explained: chi2 per sample from which on an end does not explain the data: then points are drawn once more, and
            about the start, as other starts are.
        whiteness: when residuals widen the intervals.
        identifiability: from when on a parameter counts as not known.
        contradiction: from when on traces and tests count as disagreeing.
    """

    starts: int = whole(3, 0, 1000)
    spread: float = real(0.35, 0.0, 10.0)
    seed: int = whole(20230701, 0, 2**32 - 1)
    late: tuple[float, ...] = reals((0.064, 0.016, 0.004, 0.0), 0.0, 10.0)
    rough_tolerance: float = real(1e-2, 1e-15, 1.0)
    tolerance: float = real(3e-6, 1e-15, 1.0)
    steps: int = whole(40, 1, 100_000)
    misfit: float = real(30.0, 0.0, 1e12)
    rounds: int = whole(10, 1, 1000)
    clock_rounds: int = whole(4, 0, 1000)
    off_bound_rounds: int = whole(2, 0, 1000)
    settled: float = real(0.05, 0.0, 100.0)
    alternating: float = real(1.0, 0.0, 1e6)
    wandering: float = real(10.0, 0.0, 1e6)
    decrement: float = real(1e-2, 0.0, 1e6)
    rough: float = real(0.1, 0.0, 1e6)
    reweighings: int = whole(3, 1, 1000)
    guide: GuideSettings = GuideSettings()
    search: GlobalSearchSettings = GlobalSearchSettings()
    neighbours: int = whole(6, 0, 1000)
    neighbourhood: tuple[float, ...] = reals((0.15, 0.05), 0.0, 10.0)
    first_rounds: int = whole(4, 1, 1000)
    nearly_settled: float = real(0.5, 0.0, 100.0)
    hopeful: float = real(40.0, 0.0, 1e6)
    searches: int = whole(3, 1, 1000)
    likelier: float = real(4.0, 0.0, 1e6)
    explained: float = real(2.0, 0.0, 1e12)
    whiteness: WhitenessSettings = WhitenessSettings()
    identifiability: IdentifiabilitySettings = IdentifiabilitySettings()
    contradiction: ContradictionSettings = ContradictionSettings()

    __post_init__ = check_ranges
