"""The residual of a fit channel by channel: what each of them says can be weighed, left out, or asked by itself."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import repeat
from typing import NamedTuple

import numpy as np

from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData


class Piece(NamedTuple):
    """One channel of one trace, where it was logged.

    Args:
        test, file: where it was measured.
        jacobian: of the whitened residual in the coordinates, shape (n, P).
        r: whitened residual, shape (n,).
        discount: how many times its noise a sample is taken to be off, for a model far from the data; else 1.
    """

    test: str
    file: str
    jacobian: np.ndarray
    r: np.ndarray
    discount: float = 1.0

    def moved(self, step: np.ndarray) -> np.ndarray:
        """r + J step: the residual after a step of the coordinates, shape (P,), to first order."""
        return self.r + self.jacobian @ step

    def misfit(self, step: np.ndarray | None = None) -> float:
        """Sum of squared residuals over the noise itself, after a step where one is given."""
        return self.discount**2 * float(np.sum((self.r if step is None else self.moved(step)) ** 2))


def pieces_at(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> tuple[Piece, ...]:
    """Every channel of every trace.

    Args:
        problem, weighted: the residual.
        x: coordinates at which it is linearised, shape (P,).
    """
    out = []
    every = zip(problem.batch.traces, problem.batch.places, problem.linearise_traces(x, weighted), strict=True)
    for trace, (lane, _, marks), (r, columns) in every:
        for m in range(len(trace.channels)):
            seen = np.isfinite(trace.data[:, m])
            where = trace.test.name, trace.measurement.file
            discount = float(np.median(problem.sigma[marks[seen], lane, m])) / float(trace.sigma[m])
            own = columns[m] if seen.all() else columns[m][seen]
            out.append(Piece(*where, own, r[seen, m], discount))
    return tuple(out)


def whitened(problem: EstimationProblem, pieces: Iterable[Piece]) -> tuple[np.ndarray, ...]:
    """The residual of each trace, shape (n, M) each; 0 where nothing was logged."""
    each, out = iter(pieces), []
    for trace in problem.batch.traces:
        seen = np.isfinite(trace.data)
        r = np.zeros(seen.shape)
        for m in range(len(trace.channels)):
            r[seen[:, m], m] = next(each).r
        out.append(r)
    return tuple(out)


def information_in(
    pieces: Iterable[Piece], prior_sd: np.ndarray, inflations: Iterable[float] = repeat(1.0)
) -> np.ndarray:
    """sum J^T J / f of pieces, and the information of the user's priors, shape (P, P).

    Args:
        pieces: some channels.
        prior_sd: of the coordinates, shape (P,).
        inflations: f of each.
    """
    total = np.diag(1.0 / np.asarray(prior_sd) ** 2)
    for piece, f in zip(pieces, inflations, strict=False):
        total = total + piece.jacobian.T @ piece.jacobian / f
    return total
