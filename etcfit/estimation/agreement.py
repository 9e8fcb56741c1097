"""Whether the parts of the data agree: influence of each part, width of the intervals, contradicting tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from operator import add
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from ..problem.cores import concurrently
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .contradiction import (
    Comparison,
    Contradicting,
    Contradiction,
    Subset,
    by_consequence,
    contradiction_distance,
    digits_apart,
    fitted_to,
    prior_score,
    refit_with_own_whitening,
    split_off,
    tests_of,
)
from .identifiability import WEAK
from .levenberg_marquardt import prior_information
from .settings import FitSettings
from .statement import Piece, Split, Statement, inflations_of, prior, statement

# ---- Do traces, or tests, disagree by more than their noise, and how wide must the intervals be if they do?
#
#     T_k = sum_g d_gk^2 / E[sum_g d_gk^2],    nu_k = (tr Q_k)^2 / tr Q_k^2
#
# d_g is the shift of the estimate when cluster g is left out, Q_k = cov(d_gk, d_hk) if the model is right and the noise
# is as in `inflation`: then nu_k T_k is nearly chi2 of nu_k degrees of freedom. A bench has few clusters per parameter,
# nu_k about 2, and its raw cluster covariance would be a random number; it counts only where T_k rejects agreement.
# There
#
#     C' = C + W (sum_g d_g d_g^T) W,    C'_kk = phi_k (t_(1 + nu_k) / 1.96)^2 C_kk
#     phi_k = (1 + nu_k T_k) / (1 + nu_k)
#
# with W diagonal, and 0 for all other parameters. The 1 is a prior of one degree of freedom that the noise is as
# stated: without it an interval from two clusters would be ten times as wide, or not wider at all.
#
# Source: Bell and McCaffrey 2002, Survey Methodology 28(2) (jackknife over clusters, degrees of freedom after
# Satterthwaite); Birge 1932, Phys. Rev. 40 (T); Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3(1) (phi). Differs from
# source: the variance under agreement is known here, so that it can be tested for, and nothing is ever narrowed.


_NORMAL = float(ndtri(0.975))
_BELIEVED = 1.0  # degrees of freedom
SCATTER = 0.05  # p-value below which traces, or tests, scatter by more than their noise, so that intervals are widened


class Scatter(NamedTuple):
    """How the estimates scatter when clusters are left out one by one."""

    shifts: np.ndarray  # d, shape (G, P)
    # T, shape (P,); 0 where one cluster alone determines the parameter, so that no other can disagree
    ratio: np.ndarray
    freedom: np.ndarray  # nu, shape (P,)

    @property
    def p(self) -> np.ndarray:
        """Probability of such a scatter, or a larger one, if clusters agree, shape (P,)."""
        return np.asarray(chdtrc(self.freedom, self.ratio * self.freedom))


def scatter(clusters: Sequence[Statement], believed: Statement, reach: np.ndarray, unknown: float) -> Scatter:
    """Leave out each cluster in turn."""
    everything = reduce(add, clusters, believed)
    splits = [Split(own, everything - own, reach, unknown) for own in clusters]
    shifts = np.array([split.shift for split in splits])
    alone = np.any([split.lost_without for split in splits], axis=0)
    inverse = np.linalg.inv(everything.information)
    others = np.array([split.others_inverse for split in splits])
    spread = np.array([own.spread for own in clusters])
    expected, squares = np.zeros(reach.size), np.zeros(reach.size)
    for k in range(reach.size):
        q = _covariance(inverse[k], others[:, k], spread)
        expected[k], squares[k] = np.trace(q), np.sum(q**2)
    determined = ~alone & (expected > 0.0)
    ratio = np.where(determined, np.sum(shifts**2, axis=0) / np.where(determined, expected, 1.0), 0.0)
    freedom = np.where(determined, expected**2 / np.where(determined, squares, 1.0), 1.0)
    return Scatter(shifts, ratio, np.maximum(1.0, freedom))


def _covariance(all_row: np.ndarray, without_rows: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Q_k, shape (G, G): shifts are d_g = sum_h (F^-1 - [h != g] F_(-g)^-1) s_h, and s_h has variance M_h.

    Args:
        all_row: k-th row of F^-1, shape (P,).
        without_rows: k-th row of each F_(-g)^-1, shape (G, P).
        spread: M of each cluster, shape (G, P, P).
    """
    count = len(spread)
    kept = 1.0 - np.eye(count)
    rows = all_row - kept[:, :, None] * without_rows[:, None, :]
    return np.einsum("ghp,hpq,fhq->gf", rows, spread, rows, optimize=True)


def widened(covariance: np.ndarray, every: Iterable[Scatter], level: float) -> np.ndarray:
    """The covariance widened for clusters that disagree, shape (P, P); never narrower in any direction.

    Args:
        covariance: C, shape (P, P).
        every: the scatter over traces, over tests: the wider one counts for each parameter.
        level: significance level of the test for agreement.
    """
    wide = covariance
    for each in every:
        freedom = _BELIEVED + each.freedom
        growth = (_BELIEVED + each.freedom * each.ratio) / freedom * (stdtrit(freedom, 0.975) / _NORMAL) ** 2
        target = np.where(each.p < level, np.maximum(growth, 1.0), 1.0) * np.diag(covariance)
        lack = np.maximum(target - np.diag(wide), 0.0)
        own = np.sum(each.shifts**2, axis=0)
        weight = np.sqrt(np.where(own > 0.0, lack / np.where(own > 0.0, own, 1.0), 0.0))
        scaled = each.shifts * weight
        wide = wide + scaled.T @ scaled
    return wide


# ---- Influence of each rig test and each trace on each parameter: the fit without it, in one step
#
#     pull = (x_without - x) / sd,    x_without - x = -(F - F_g)^-1 (s - s_g) + F^-1 s
#
# F, s and sd are those of all data, F_g and s_g those of the part left out, see `statement`; sd is due to noise alone,
# not widened. Exact if the model is linear. A parameter that the remaining data do not determine has no pull: `alone`
# names it.
#
# Source: Belsley, Kuh and Welsch 1980, Regression Diagnostics, eq. 2.1 (DFBETAS). Differs from source: rows are left
# out by trace and by test, and sd is that of all data.


@dataclass(frozen=True)
class Pull:
    """The shift of one parameter when a part of the data is left out."""

    test: str  # the rig test left out, or the test of the file left out
    file: str | None  # the file left out; None for the whole test
    parameter: str  # symbol
    pull: float  # the shift in standard errors of noise alone
    moved: float  # the shift of the coordinate


@dataclass(frozen=True)
class Influence:
    """Which part of the data determines which parameter."""

    # every part of the data on every parameter that the others determine as well; the largest first
    pulls: tuple[Pull, ...] = ()
    # parameters that one rig test, or one file, determines alone: symbol to its name
    alone: Mapping[str, str] = field(default_factory=dict)

    def largest(self, least: float, most: int) -> tuple[Pull, ...]:
        """The largest pulls.

        Args:
            least: smallest pull, standard errors.
        """
        return tuple(pull for pull in self.pulls[:most] if abs(pull.pull) >= least)


def root(variance: np.ndarray, instead: float) -> np.ndarray:
    """sqrt(variance), shape (P,); `instead` where rounding makes the variance of an undetermined parameter negative."""
    return np.sqrt(np.where(variance > 0.0, variance, instead))


def influence(
    symbols: Sequence[str],
    traces: Mapping[tuple[str, str], Statement],
    believed: Statement,
    reach: np.ndarray,
    unknown: float,
) -> Influence:
    """Leave out each test and, if it has several traces, each of its traces."""
    everything = reduce(add, traces.values(), believed)
    sd = root(np.diag(np.linalg.inv(everything.information)), np.inf)
    known = sd < unknown * reach
    pulls, alone = [], {}
    for (test, file), own in parts(traces).items():
        split = Split(own, everything - own, reach, unknown)
        lost = split.lost_without
        alone = {s: file or test for s, gone, k in zip(symbols, lost, known, strict=True) if gone and k} | alone
        rows = zip(symbols, split.shift.tolist(), sd.tolist(), known & ~lost, strict=True)
        pulls += [Pull(test, file, s, moved / sigma, moved) for s, moved, sigma, determined in rows if determined]
    return Influence(tuple(sorted(pulls, key=lambda each: -abs(each.pull))), alone)


def parts(traces: Mapping[tuple[str, str], Statement]) -> dict[tuple[str, str | None], Statement]:
    """The statement of each test, with None for its file, and of each trace of a test that has several."""
    tests: dict[str, list[str]] = {}
    for test, file in traces:
        tests.setdefault(test, []).append(file)
    out: dict[tuple[str, str | None], Statement] = {}
    for test, files in tests.items():
        out[test, None] = reduce(add, (traces[test, f] for f in files))
        out |= {(test, f): traces[test, f] for f in files if len(files) > 1}
    return out


# ---- Parameters of a model that is far from its data, or of tests that contradict each other: the range that subsets
# give.
#
#     [min, max] over the fits to all tests but one of x_g -+ 1.96 sd_g, and over the estimates of single tests, x_g
#
# Only subsets that determine a parameter contribute; the interval stated for all the data is always inside. It is not a
# statistical interval: errors that all tests share, such as a wrong angle scale, move every subset in the same way.

Z_95 = 1.96  # half width of a 95 % interval, standard deviations


@dataclass(frozen=True, eq=False)
class Compromise:
    """The results of subsets of the data."""

    why: str  # the reason in words
    without: tuple[str, ...]  # tests left out, G
    points: np.ndarray  # coordinates of the fits without them, shape (G, P)
    covariances: np.ndarray  # of those coordinates, shape (G, P, P)
    # coordinates by one test alone, in one linearised step, NaN where it does not determine them, shape (S, P)
    alone: np.ndarray

    def ends(self, half: float, low: np.ndarray, high: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Range of each coordinate, shape (P,) each.

        Args:
            half: half width of an interval, standard deviations.
            low, high: the interval stated for all the data, shape (P,).
            most: standard deviation above which a subset does not determine a coordinate, shape (P,).
        """
        sd = np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=1, axis2=2), 0.0))
        determined = sd < most
        lows = np.where(determined, self.points - half * sd, np.inf)
        highs = np.where(determined, self.points + half * sd, -np.inf)
        alone = np.where(np.isnan(self.alone), np.inf, self.alone), np.where(np.isnan(self.alone), -np.inf, self.alone)
        return (np.min(np.vstack((low, lows, alone[0])), axis=0), np.max(np.vstack((high, highs, alone[1])), axis=0))

    def covariance(self, half: float, stated: np.ndarray, x: np.ndarray, most: np.ndarray) -> np.ndarray:
        """The covariance whose intervals reach as far as the ranges, correlations kept, shape (P, P).

        Args:
            half: half width of an interval, standard deviations.
            stated: covariance for all the data, shape (P, P).
            most: as in `ends`.
        """
        variance = np.diag(stated)
        known = np.isfinite(variance) & (variance > 0.0)
        sd = np.sqrt(np.where(known, variance, 1.0))
        low, high = self.ends(half, x - half * sd, x + half * sd, most)
        wider = np.where(known, np.maximum(high - x, x - low) / (half * sd), 1.0)
        return stated * np.outer(wider, wider)


def compromise_reason(far: bool, chi2: float, contradicting: Iterable[str], settings: FitSettings) -> str | None:
    """Why the parameters are a compromise: model far, chi2 per degree of freedom, contradicting tests; None if none."""
    if far or chi2 >= settings.contradiction.compromise:
        return f"the model is far from the data (chi2/dof {chi2:.3g})"
    if names := tuple(contradicting):
        return f"{' and '.join(names)} contradict{'s' if len(names) == 1 else ''} the other tests"
    return None


_SEEN = 1.0  # standard errors by which a parameter must move to show a contradiction
_LOOK = (
    "Look for a difference in that test: series resistance, a sensor, wiring, temperature, or an effect that the model "
    "lacks."
)


@dataclass(frozen=True, eq=False)
class Agreement:
    """How far the parts of the data agree."""

    influence: Influence  # how far each part moves each parameter
    covariance: np.ndarray  # of the coordinates, wide enough for the scatter of traces and tests, shape (P, P)
    contradictions: tuple[Contradiction, ...] = ()  # tests that contradict the others, worst first
    outweighed: tuple[Contradiction, ...] = ()  # tests that disagree with the others, but move no parameter
    # results of subsets of the data, if the parameters are no estimates; else None
    compromise: Compromise | None = None

    def words(self, units: Callable[[str], str]) -> list[str]:
        """Warnings; `units` gives the SI unit of a symbol."""
        return [
            *(in_words(each, units(each.parameter)) for each in self.contradictions),
            *map(outweighed_in_words, self.outweighed),
        ]


@dataclass(frozen=True, eq=False)
class _FittedData:
    """The data that are compared: the problem at its optimum; see `agreement`."""

    problem: EstimationProblem
    weighted: WeightedData
    x: np.ndarray
    pieces: tuple[Piece, ...]
    settings: FitSettings
    made: dict[tuple[str, ...], Subset] = field(default_factory=dict)  # refits to subsets, by their tests

    @property
    def reach(self) -> np.ndarray:
        return self.problem.layout.reach(self.x)

    @property
    def unknown(self) -> float:
        return self.settings.identifiability.unknown

    @property
    def everything(self) -> Subset:
        return Subset(tests_of(self.problem), self.x, self.pieces, prior_score(self.problem, self.weighted, self.x))

    def believed(self, here: Subset) -> Statement:
        """The priors: those given, and `WIDE` about the end of the fit."""
        return prior(prior_information(self.problem.layout, self.x, self.weighted.prior_sd), here.belief)

    def refitted(self, x: np.ndarray, tests: tuple[str, ...]) -> Subset:
        """The refit to some tests, from x, shape (P,); made once."""
        if tests not in self.made:
            self.made[tests] = fitted_to(self.problem, self.weighted, x, tests, self.settings)
        return self.made[tests]

    def freed(self, each: Contradicting) -> Contradicting:
        """A contradicting test, with the others fitted under a whitening that this test does not influence."""
        rest = refit_with_own_whitening(self.problem, each.without, self.settings)
        self.made[rest.tests] = rest
        return replace(each, without=rest)

    def covariance(self, here: Subset) -> np.ndarray:
        """Covariance of the coordinates from a subset, widened for the subset's own residual, shape (P, P)."""
        counted = [piece for piece in here.pieces if piece.test in here.tests]
        said = statement(counted, inflations_of(counted)) + self.believed(here)
        inverse = np.linalg.inv(said.information)
        return inverse @ said.spread @ inverse


def agreement(
    problem: EstimationProblem,
    weighted: WeightedData,
    x: np.ndarray,
    pieces: tuple[Piece, ...],
    covariance: np.ndarray,
    misfit: tuple[bool, float],
    settings: FitSettings,
) -> Agreement:
    """Compare every trace and every test of a fit with the others.

    Args:
        pieces: every channel of every trace, linearised at the optimum.
        covariance: covariance of the coordinates, widened channel by channel, shape (P, P).
        misfit: whether the model is far from the data, and chi2 per degree of freedom.
    """
    if not all(np.isfinite(piece.jacobian).all() and np.isfinite(piece.r).all() for piece in pieces):
        return Agreement(Influence(), covariance)
    data = _FittedData(problem, weighted, x, pieces, settings)
    believed = data.believed(data.everything)
    traces = _by_trace(pieces)
    found = influence(problem.layout.free, traces, believed, data.reach, data.unknown)
    tests = [said for (_, file), said in parts(traces).items() if file is None]
    every = (scatter(each, believed, data.reach, data.unknown) for each in ([*traces.values()], tests))
    wide = widened(covariance, every, SCATTER)
    comparison = Comparison(data.refitted, data.believed, data.reach, data.unknown, settings.contradiction)
    # far from the data each channel is weighted by its own error, so a wrong test hardly counts
    contradicting = () if misfit[0] else tuple(map(data.freed, comparison.contradicting(data.everything)))
    named = tuple(_named(data, each) for each in contradicting)
    real, outweighed = by_consequence(named, settings.contradiction.moves)
    why = compromise_reason(*misfit, (each.test for each in real), settings)
    return Agreement(found, wide, real, outweighed, None if why is None else _compromise(data, why))


def _by_trace(pieces: Sequence[Piece]) -> dict[tuple[str, str], Statement]:
    out: dict[tuple[str, str], Statement] = {}
    for piece, f in zip(pieces, inflations_of(pieces), strict=True):
        said, key = statement((piece,), (f,)), (piece.test, piece.file)
        out[key] = out[key] + said if key in out else said
    return out


def _named(data: _FittedData, each: Contradicting) -> Contradiction:
    """The contradiction, with the parameter that the test pulls most, of those that the others determine."""
    layout = data.problem.layout
    said = reduce(add, (statement((piece,), (1.0,)) for piece in data.pieces), data.believed(data.everything))
    sd = np.sqrt(np.diag(np.linalg.inv(said.information)))
    known = np.sqrt(np.diag(data.covariance(each.without))) < data.unknown * data.reach
    pulls = (each.without.x - each.together.x) / sd
    k = int(np.argmax(np.where(known, np.abs(pulls), -1.0)))
    with_it, without = (float(layout.numbers(here.x)[0][k]) for here in (each.together, each.without))
    moved = contradiction_distance(each, data.believed(each.together), data.reach, data.unknown)
    return Contradiction(each.test, layout.free[k], float(pulls[k]), with_it, without, each.p, each.share, moved)


def _compromise(data: _FittedData, why: str) -> Compromise:
    """The range from subsets: the refit without each test, and one step to each test alone."""
    tests, size = tests_of(data.problem), data.x.size
    left_out = tests if len(tests) > 1 else ()
    rest = [tuple(each for each in tests if each != test) for test in left_out]
    without = concurrently(partial(data.refitted, data.x), rest)
    return Compromise(
        why,
        left_out,
        np.array([here.x for here in without]).reshape(-1, size),
        np.array([data.covariance(here) for here in without]).reshape(-1, size, size),
        np.array([_alone(data, test) for test in left_out]).reshape(-1, size),
    )


def _alone(data: _FittedData, test: str) -> np.ndarray:
    """Coordinates by one test alone, one step from the optimum, shape (P,); NaN where the test does not determine them,
    or where its optimum is too far for one step."""
    believed = data.believed(data.everything)
    split = split_off(data.everything, test, believed, data.reach, data.unknown)
    sd = np.sqrt(np.diag(np.linalg.inv(split.own.information + believed.information)))
    near = np.abs(split.own_step) < data.unknown * data.reach
    known = sd < WEAK * data.reach
    return np.where(known & near, data.x + split.own_step, np.nan)


def in_words(each: Contradiction, unit: str) -> str:
    """The warning for a test that contradicts the others; unit: SI unit of the parameter that it pulls."""
    if abs(each.pull) < _SEEN:
        return (
            f"{each.test} contradicts the other tests: without it a combination of parameters moves by "
            f"{each.moved:.2g} standard errors of noise alone, though no single parameter moves by as much as "
            f"{_SEEN:g}. {_LOOK}"
        )
    digits = digits_apart(each.without, each.value)
    return (
        f"{each.test} contradicts the other tests: without it {each.parameter} is {each.without:.{digits}g} {unit} "
        f"instead of {each.value:.{digits}g} ({each.pull:+.2g} standard errors of noise alone). {_LOOK}"
    )


def outweighed_in_words(each: Contradiction) -> str:
    """The warning for a test that disagrees with the others but moves no parameter."""
    return (
        f"{each.test} disagrees with the other tests by more than its noise, but the others outweigh it: without it no "
        f"parameter moves by more than {each.moved:.2g} standard errors. The parameters remain valid. {_LOOK}"
    )
