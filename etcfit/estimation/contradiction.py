"""Which rig test contradicts the others: the refit without it, and how far the two sides disagree."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, prior_residual_here
from ..problem.trace import Trace
from .levenberg_marquardt import descend
from .settings import ContradictionSettings, FitSettings
from .statement import Piece, Split, Statement, inflations_of, pieces_at, statement

# ---- The refit to some of the rig tests: same model, same whitening, same compiled programs, other weights


_CLOSE = 1e-4  # relative change of chi2 that ends a descent: far less than the difference between parts that disagree

_RENEWALS = 3  # of a subset's whitening


@dataclass(frozen=True, eq=False)
class Subset:
    """The fit to a part of the data."""

    tests: tuple[str, ...]  # the tests that count
    x: np.ndarray  # coordinates, shape (P,)
    pieces: tuple[Piece, ...]  # every channel of every trace linearised at x, including those that do not count
    belief: np.ndarray  # score of the priors at x, shape (P,)


def tests_of(problem: EstimationProblem) -> tuple[str, ...]:
    """Every rig test among the traces."""
    return tuple(dict.fromkeys(trace.test.name for trace in problem.batch.traces))


def fitted_to(
    problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, tests: Collection[str], settings: FitSettings
) -> Subset:
    """Descend from x with some tests only."""
    counts = with_only_weights_of(problem, weighted, lambda trace: trace.test.name in tests)
    end, _ = descend(problem, x, counts, _CLOSE, settings.steps)
    return at(problem, weighted, end, tests)


def refit_with_own_whitening(problem: EstimationProblem, here: Subset, settings: FitSettings) -> Subset:
    """The refit to a subset with its own whitening and outliers.

    Whitening and outliers of all the data were computed along a path that the test left out had influenced. Sums of
    squares before and after are not comparable.
    """
    fresh = replace(problem, sigma=problem.batch.slots.sigma)
    for _ in range(_RENEWALS):
        here = fitted_to(fresh, fresh.weighted(fresh.kalman(here.x)), here.x, here.tests, settings)
    return here


def at(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, tests: Collection[str]) -> Subset:
    """All data linearised at x, shape (P,), of which some tests count."""
    return Subset(tuple(tests), x, pieces_at(problem, x, weighted), prior_score(problem, weighted, x))


def prior_score(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray) -> np.ndarray:
    """Score of the priors at x, (x - mean) / sd^2, shape (P,)."""
    own = prior_residual_here(problem.layout.padded(x), weighted) / np.asarray(weighted.prior_sd)
    return own[: x.size]


def with_only_weights_of(
    problem: EstimationProblem, weighted: WeightedData, counts: Callable[[Trace], bool]
) -> WeightedData:
    """The data with the weights of all traces set to 0, except those that count."""
    weight = np.array(weighted.whitening.weight)
    for trace, (lane, _, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        if not counts(trace):
            weight[marks, lane] = 0.0
    return weighted._replace(whitening=weighted.whitening._replace(weight=weight))


# ---- How far two parts of the data disagree, each with parameters of its own
#
#     T = z^T cov(z)^-1 z,    z_i = b_i^T F (x_own - x_others)
#
# in the directions b_i that both sides determine, see `statement`. The noise of each side comes from its own residual
# with its own parameters (`inflation`), so that no test is named if the model fits neither side. T is compared with
# Hotelling's T^2 of the smaller side's independent samples.
#
# Source: Hausman 1978, Econometrica 46(6). Differs from source: the estimates compared are those of two disjoint parts
# of the data.

_LEAST = 1e-4  # share of the information of a direction below which a side does not count there
_SURE = 3.0  # standard deviations by which noise alone may exceed its mean


@dataclass(frozen=True, eq=False)
class Parted:
    """One test and the others, each with its own parameters."""

    split: Split  # the two sides
    misfit: float  # sum of squared residuals of both sides together, over the noise itself
    samples: int  # number of samples of both sides

    def share(self, together: float) -> float:
        """Share of the misfit that disappears if the sides need not agree; the part due to noise counts as no misfit.

        Args:
            together: sum of squared residuals if they must agree.
        """
        gain = max(0.0, together - self.misfit)
        left = max(0.0, self.misfit - self.samples - _SURE * (2.0 * self.samples) ** 0.5)
        return gain / (gain + left) if gain > 0.0 else 0.0


def disagreement(split: Split, understated: float = 1.0) -> float:
    """log p of T; 0 if no direction is determined by both sides, or a side has too few independent samples.

    Args:
        understated: factor by which the errors may exceed the stated standard errors.
    """
    common = (
        split.determined_by_own & split.determined_by_others & (split.share > _LEAST) & (split.others_share > _LEAST)
    )
    count = int(common.sum())
    freedom = min(split.own.samples, split.others.samples) - count + 1.0
    if not count or freedom < 1.0:
        return 0.0
    b = split.directions[:, common]
    own, others = b / split.share[common], b / split.others_share[common]
    z = others.T @ split.others.score - own.T @ split.own.score
    spread = own.T @ split.own.spread @ own + others.T @ split.others.spread @ others
    t2 = float(z @ np.linalg.solve(spread, z)) / understated**2
    with np.errstate(divide="ignore"):  # log 0: p underflows
        return float(np.log(fdtrc(count, freedom, max(t2, 0.0) * freedom / ((freedom + count - 1.0) * count))))


def parted(
    here: Subset, test: str, believed: Statement, reach: np.ndarray, unknown: float, alone: Subset | None = None
) -> Parted:
    """One test and the others, linearised at the same point.

    Args:
        here: the fit to the others, or to all tests.
        believed: the priors, at that point.
        alone: the fit to this test alone, where its own optimum is more than one step away: linearised there.
    """
    own, others = sides_of(here, test)
    if alone is not None:
        away = here.x - alone.x
        own = [piece._replace(r=piece.residual_after(away)) for piece in alone.pieces if piece.test == test]
    first = Split(undisputed(own), undisputed(others) + believed, reach, unknown)
    steps = first.own_step, first.others_step
    sides = [statement(side, inflations_of(side, step)) for side, step in zip((own, others), steps, strict=True)]
    misfit = sum(piece.misfit(step) for side, step in zip((own, others), steps, strict=True) for piece in side)
    count = sum(piece.r.size for piece in (*own, *others))
    return Parted(Split(sides[0], sides[1] + believed, reach, unknown), misfit, count)


def sides_of(here: Subset, test: str) -> tuple[list[Piece], list[Piece]]:
    """The channels of a test, and those of the other tests that count."""
    own = [piece for piece in here.pieces if piece.test == test]
    return own, [piece for piece in here.pieces if piece.test in here.tests and piece.test != test]


def undisputed(pieces: Sequence[Piece]) -> Statement:
    """The statement of channels with the declared noise."""
    return statement(pieces, [1.0] * len(pieces))


def split_off(here: Subset, test: str, believed: Statement, reach: np.ndarray, unknown: float) -> Split:
    """One test and the others that count, with the declared noise."""
    own, others = sides_of(here, test)
    return Split(undisputed(own), undisputed(others) + believed, reach, unknown)


# ---- Which rig test contradicts the others: it is left out, the others are refitted, and the two sides are compared
#
# The level is divided by the number of tests (Holm's first step). Of the contradicting tests, the one is named that
# explains most of the misfit if it may differ; then the others are tested again without it, so that a test that
# disagrees only with the named one is not named too.
#
# Source: Holm 1979, Scand. J. Statist. 6. Differs from source: only the worst of all that could be rejected is
# rejected, and the rest is tested again.


_SHARE = 0.5  # share of the misfit that must disappear if a test may differ from the others, for the test to be named
NAMED = 1  # largest number of named tests; when one is mended, the next shows by itself


@dataclass(frozen=True)
class Contradiction:
    """A rig test that the others contradict."""

    test: str  # name of the test
    parameter: str  # symbol of the parameter that it pulls most
    pull: float  # shift of that parameter without the test, standard errors of noise alone
    # value, without: value of that parameter with the test and without it, SI
    value: float
    without: float
    # probability of so large a disagreement, or a larger one, if tests agree and errors are larger than stated by the
    # allowed factor (`ContradictionSettings.understated`)
    p: float
    share: float  # share of the misfit that disappears if this test may differ from the others
    # shift without the test of the combination of parameters that moves most, standard errors of noise alone; see
    # `contradiction_distance`
    moved: float = math.inf


def digits_apart(one: float, other: float) -> int:
    """Significant digits, 3 to 8, at which two numbers in one unit differ by more than one unit of the last digit."""
    gap, size = abs(one - other), max(abs(one), abs(other))
    if not (math.isfinite(gap) and gap > 0.0):
        return 3
    return min(max(3, 1 + math.ceil(math.log10(size / gap))), 8)


@dataclass(frozen=True, eq=False)
class Contradicting:
    """A test that contradicts the others."""

    test: str  # which
    # together, without: the fit with the test, and the fit to the others
    together: Subset
    without: Subset
    # p, share: see `Contradiction`
    p: float
    share: float
    gain: float  # fall of the sum of squared residuals, over the noise itself, if the test may differ


def contradiction_distance(each: Contradicting, believed: Statement, reach: np.ndarray, unknown: float) -> float:
    """How far leaving a test out moves the fit, along the combination of parameters that moves most.

        sqrt(sum_i (b_i^T F (x_without - x_together))^2)    over the directions b_i that the others determine

    in standard errors of noise alone: 1 along b_i is one standard error of all the data together. No parameter, and no
    combination of parameters, moves by more.
    """
    split = split_off(each.together, each.test, believed, reach, unknown)
    information = split.own.information + split.others.information
    along = split.directions[:, split.determined_by_others].T @ information @ (each.without.x - each.together.x)
    return float(np.linalg.norm(along))


def by_consequence(
    found: Sequence[Contradiction], least: float
) -> tuple[tuple[Contradiction, ...], tuple[Contradiction, ...]]:
    """Tests that contradict the others, and those that the others outweigh.

    Args:
        least: least shift of a contradiction, standard errors; see `ContradictionSettings.moves`.
    """
    return tuple(each for each in found if each.moved >= least), tuple(each for each in found if each.moved < least)


@dataclass(frozen=True)
class Comparison:
    """How tests are compared."""

    refitted: Callable[[np.ndarray, tuple[str, ...]], Subset]  # refits to some tests, from coordinates of shape (P,)
    believed: Callable[[Subset], Statement]  # the priors, at a subset's coordinates
    reach: np.ndarray  # reach of each coordinate, shape (P,)
    unknown: float  # standard deviation above which a parameter is not known, reaches
    settings: ContradictionSettings  # thresholds

    def contradicting(self, everything: Subset) -> tuple[Contradicting, ...]:
        """The tests that contradict the others, worst first."""
        here, found = everything, []
        while len(here.tests) > 1 and len(found) < NAMED:
            worst = self._worst(here)
            if worst is None:
                break
            found.append(worst)
            here = worst.without
        return tuple(found)

    def _worst(self, here: Subset) -> Contradicting | None:
        bound = self._bound(here)
        together = sum(piece.misfit() for piece in here.pieces if piece.test in here.tests)
        believed = self.believed(here)
        likely = []
        for test in here.tests:  # to first order, with the declared noise: cheap, and never too lenient
            split = split_off(here, test, believed, self.reach, self.unknown)
            if self._unlikely(split) < bound:
                likely.append(test)
        tried = (self._tried(here, test, together) for test in likely)
        proven = [each for each in tried if np.log(max(each.p, 1e-300)) < bound and each.share >= _SHARE]
        return max(proven, key=lambda each: each.gain, default=None)

    def _bound(self, here: Subset) -> float:
        """log p below which a test contradicts the others, for this number of tests."""
        return float(np.log(self.settings.level / len(here.tests)))

    def _unlikely(self, split: Split) -> float:
        return disagreement(split, self.settings.understated)

    def _tried(self, here: Subset, test: str, together: float) -> Contradicting:
        without = self.refitted(here.x, tuple(each for each in here.tests if each != test))
        arguments = without, test, self.believed(without), self.reach, self.unknown
        two = parted(*arguments)
        if two.share(together) >= _SHARE and self._unlikely(two.split) > self._bound(here):
            two = parted(*arguments, self.refitted(without.x, (test,)))  # its own optimum may be more than a step away
        p = float(np.exp(self._unlikely(two.split)))
        return Contradicting(test, here, without, p, two.share(together), together - two.misfit)
