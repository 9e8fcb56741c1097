"""Scores a model on fitted traces, held-out traces and traces left out in turn, and measures how far two tied models
are apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..estimation.goodness import inflation
from ..estimation.levenberg_marquardt import minimise
from ..problem.chi2 import chi2_of
from ..problem.cores import concurrently
from ..problem.prediction_error import PredictionError, columns, pooled, rows
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel
from .formula_errors import EXACT, FormulaErrors
from .tangents import fitted_samples

# ---- The score of a model: errors on the fitted traces and on the held-out ones


FOLD_TOLERANCE = 1e-3  # relative change of chi2 that ends a refit without one group


@dataclass(frozen=True, eq=False)
class Score:
    """The errors of a model, fitted and held out."""

    chi2: float  # sum of squares of the whitened residual of the fitted traces, r^T M^-1 r with the formula errors M
    count: float  # number of independent samples among them
    held_out: float | None  # chi2 of the held-out traces; None where there are none
    # fit_rows, holdout_rows: free-run errors by trace and channel
    fit_rows: tuple[PredictionError, ...] = field(repr=False)
    holdout_rows: tuple[PredictionError, ...] = field(repr=False)
    errors: FormulaErrors = EXACT  # covariance M of the residual by inexact formulas

    @property
    def fit_rms(self) -> float:
        """Free-run RMS of the fitted traces, in sigma."""
        return pooled(self.fit_rows)

    @property
    def holdout_rms(self) -> float | None:
        """Free-run RMS of the held-out traces, in sigma."""
        return pooled(self.holdout_rows) if self.holdout_rows else None

    @property
    def likelihood_per_chi2(self) -> float:
        """count / chi2: by how much -2 log likelihood changes for one unit of chi2."""
        return self.count / max(self.chi2, 1e-300)


def clearly_worse(rms: float, before: float, rise: float) -> bool:
    """Whether an RMS rose by more than the relative `rise`, or is NaN."""
    return not rms < (1.0 + rise) * before


def holdout_worsened(rms: float | None, before: float | None, rise: float) -> bool:
    """Whether a held-out RMS rose by more than the relative `rise`; False where nothing is held out."""
    return rms is not None and before is not None and clearly_worse(rms, before, rise)


def holdout_rms(s: CandidateModel) -> float | None:
    """`Score.holdout_rms` alone."""
    return pooled(_holdout_rows(s)) if s.holdout is not None else None


def _holdout_rows(s: CandidateModel) -> tuple[PredictionError, ...]:
    if s.holdout is None:
        return ()
    problem, _ = s.holdout
    return rows(problem.batch.traces, problem.free_run(s.x))


def score(s: CandidateModel, errors: FormulaErrors = EXACT) -> Score:
    """Judge a model at its coordinates.

    Args:
        errors: formula errors of a model that this one contains.
    """
    r = s.problem.residual(s.x, s.weighted)
    held_out = None
    if s.holdout is not None:
        problem, weighted = s.holdout
        held_out = _held_out_chi2(problem, weighted, s.x, errors.held_out)
    fit_rows = rows(s.problem.batch.traces, s.problem.free_run(s.x))
    count = independent(_channels(s.problem, r))
    return Score(_chi2(s, r, errors), count, held_out, fit_rows, _holdout_rows(s), errors)


def _held_out_chi2(
    problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, errors: FormulaErrors | None
) -> float:
    if not errors:
        return float(chi2_of(problem, x[None], weighted)[0])
    r = errors.whitened(problem.residual(x, weighted)[np.asarray(weighted.slots.weight) > 0.0])
    return float(r @ r)


def baseline(s: CandidateModel) -> Score:
    """The score of a model that larger ones are compared with: under its own formula errors."""
    return score(s, FormulaErrors.of_model(s))


def _chi2(s: CandidateModel, r: np.ndarray, errors: FormulaErrors) -> float:
    if not errors:
        return float(np.sum(r**2))
    own, jacobian = fitted_samples(s.problem, s.x, s.weighted)
    return errors.chi2(own, jacobian[:, [s.problem.layout.free.index(symbol) for symbol in errors.free]])


def _channels(problem: EstimationProblem, r: np.ndarray) -> Iterator[np.ndarray]:
    """Residual of each channel of each trace where it was logged, shape (n,); r has shape (T, L, M)."""
    for trace, part in zip(problem.batch.traces, columns(problem.batch, r), strict=True):
        for m in range(len(trace.channels)):
            yield part[np.isfinite(trace.data[:, m]), m]


def independent(residuals: Iterable[np.ndarray]) -> float:
    """Number of independent samples that the residuals of several channels, shape (n,) each, contain together.

        sum over channels of n / f,    f = inflation of the variance of a mean by autocorrelation

    A residual larger than its noise is first scaled to RMS 1.
    """
    count = 0.0
    for own in residuals:
        size = float(np.sqrt(np.mean(own**2))) if own.size else 1.0
        count += own.size / inflation(own / max(size, 1.0))
    return count


# ---- Where no trace is held out: leave traces out in turn, refit without them, score on them


def groups_of(moving: Sequence[int], folds: int) -> list[list[int]]:
    """Traces left out together: dealt out one by one to `folds` groups; empty where fewer than two traces move."""
    if len(moving) < 2:
        return []
    return [list(moving[start::folds]) for start in range(min(folds, len(moving)))]


def folds(s: CandidateModel) -> list[np.ndarray]:
    """Samples left out together, in turn: 1 in a mask of shape (T, L), 0 elsewhere; traces of a held plate are never
    left out."""
    moving = [k for k, t in enumerate(s.problem.batch.traces) if not t.test.boundary.plate_held]
    return [_mask(s, group) for group in groups_of(moving, s.settings.folds)]


def _mask(s: CandidateModel, group: Sequence[int]) -> np.ndarray:
    batch = s.problem.batch
    mask = np.zeros(batch.steps.dt.shape)
    for k in group:
        lane, row, marks = batch.places[k]
        mask[row : marks[-1] + 1, lane] = 1.0
    return mask


def only(weighted: WeightedData, mask: np.ndarray) -> WeightedData:
    """The data with weight 0 for samples outside the mask, shape (T, L); everything else unchanged."""
    keep = mask[..., None]
    slots = weighted.slots._replace(weight=weighted.slots.weight * keep)
    return weighted._replace(
        slots=slots, whitening=weighted.whitening._replace(weight=weighted.whitening.weight * keep)
    )


def refitted_without(s: CandidateModel, mask: np.ndarray) -> np.ndarray:
    """Coordinates, shape (P,), of the model refitted to the samples outside the mask, shape (T, L)."""
    return minimise(s.problem, s.x, only(s.weighted, 1.0 - mask), FOLD_TOLERANCE)[0]


def chi2_within(s: CandidateModel, x: np.ndarray, mask: np.ndarray) -> float:
    """chi2 of the samples in the mask, shape (T, L), at coordinates x, shape (P,); priors included."""
    return float(chi2_of(s.problem, x[None], only(s.weighted, mask))[0])


def left_out(s: CandidateModel) -> float:
    """chi2 of all traces that move, each group predicted by the model refitted without it.

    Models under one whitening can be compared by it; where there are too few traces to leave any out, it is 0 for all.
    """
    return sum(concurrently(lambda mask: chi2_within(s, refitted_without(s, mask), mask), folds(s)))


# ---- Effects that these data cannot tell apart: how far their fits are, and how the tie widens the intervals
#
# Each of two tied models may be the true one, so an interval must hold the value that either gives:
#
#     C' = C + sum_t d_t d_t^T,    d_t = x_t - x of what both models fit
#
# Source: Buckland, Burnham and Augustin 1997, Biometrics 53(2) (model uncertainty). Differs from source: the whole
# difference is taken, not one weighted by the models' odds, which are unknown in a tie.


@dataclass(frozen=True)
class Apart:
    """How far the fit with another effect is from the fit with the one that was added."""

    residual: float  # rms over the samples, in units of the noise
    moved: Mapping[str, float]  # difference of each coordinate that both models fit, by symbol


def distance_to(other: CandidateModel, best: CandidateModel) -> Apart:
    """The distance between two models under one whitening."""
    difference = other.problem.residual(other.x, other.weighted) - best.problem.residual(best.x, best.weighted)
    here, there = (dict(zip(s.problem.layout.free, s.x.tolist(), strict=True)) for s in (best, other))
    return Apart(distance(difference, best.weighted.samples), coordinate_changes(there, here))


def distance(difference: np.ndarray, samples: float) -> float:
    """sqrt(sum d^2 / n) of two whitened residuals' difference d, shape (T, L, M), with n samples among its entries."""
    return float(np.sqrt(np.sum(difference**2) / samples))


def coordinate_changes(there: Mapping[str, float], here: Mapping[str, float]) -> dict[str, float]:
    """x_t - x of each coordinate that both models fit, by symbol."""
    return {symbol: there[symbol] - here[symbol] for symbol in here.keys() & there.keys()}


def tie_covariance(free: Sequence[str], ties: Iterable[Apart]) -> np.ndarray:
    """sum_t d_t d_t^T: covariance of the coordinates that is added because the tied effects cannot be told apart.

    Args:
        free: symbols of the P coordinates; a coordinate that a tied model does not fit counts as not moved.
    Returns:
        shape (P, P).
    """
    out = np.zeros((len(free), len(free)))
    for tie in ties:
        d = np.array([tie.moved.get(symbol, 0.0) for symbol in free])
        out += np.outer(d, d)
    return out
