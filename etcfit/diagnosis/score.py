"""How well a model does: on the traces that were fitted, and on those that were not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ..estimation.autocorrelation import inflation
from ..problem.chi2 import chi2_of
from ..problem.prediction_error import PredictionError, columns, pooled, rows
from ..problem.problem import EstimationProblem
from .candidate_model import CandidateModel


@dataclass(frozen=True, eq=False)
class Score:
    """How well a model does, fitted and held out.

    Args:
        chi2: sum of squares of the whitened residual of the fitted traces.
        count: of independent samples among them.
        held_out: chi2 of the held-out traces; None where there are none.
        fit_rows, holdout_rows: free-run errors by trace and channel.
    """

    chi2: float
    count: float
    held_out: float | None
    fit_rows: tuple[PredictionError, ...] = field(repr=False)
    holdout_rows: tuple[PredictionError, ...] = field(repr=False)

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

    def strays(self, before: Score, rise: float) -> bool:
        """`strays` of the held-out RMS."""
        return strays(self.holdout_rms, before.holdout_rms, rise)


def clearly_worse(rms: float, before: float, rise: float) -> bool:
    """Whether an RMS rose by more than the relative `rise`, or is NaN."""
    return not rms < (1.0 + rise) * before


def strays(rms: float | None, before: float | None, rise: float) -> bool:
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


def score(s: CandidateModel) -> Score:
    """Judge a model at its coordinates."""
    r = s.problem.residual(s.x, s.weighted)
    held_out = None
    if s.holdout is not None:
        problem, weighted = s.holdout
        held_out = float(chi2_of(problem, s.x[None], weighted)[0])
    fit_rows = rows(s.problem.batch.traces, s.problem.free_run(s.x))
    return Score(float(np.sum(r**2)), independent(_channels(s.problem, r)), held_out, fit_rows, _holdout_rows(s))


def _channels(problem: EstimationProblem, r: np.ndarray) -> Iterator[np.ndarray]:
    """Residual of each channel of each trace where it was logged, shape (n,); r has shape (T, L, M)."""
    for trace, part in zip(problem.batch.traces, columns(problem.batch, r), strict=True):
        for m in range(len(trace.channels)):
            yield part[np.isfinite(trace.data[:, m]), m]


def independent(residuals: Iterable[np.ndarray]) -> float:
    """How many independent samples the residuals of several channels, shape (n,) each, are worth together.

        sum over channels of n / f,    f = inflation of the variance of a mean by autocorrelation

    A residual larger than its noise is brought to size 1 first.
    """
    count = 0.0
    for own in residuals:
        size = float(np.sqrt(np.mean(own**2))) if own.size else 1.0
        count += own.size / inflation(own / max(size, 1.0))
    return count
