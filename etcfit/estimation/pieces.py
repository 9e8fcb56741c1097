"""The residual of a fit channel by channel: what each of them says can be weighed, left out, or asked by itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem, Linearisation


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


def pieces_of(problem: EstimationProblem, here: Linearisation) -> tuple[Piece, ...]:
    """Every channel of every trace.

    Args:
        problem: the data.
        here: their residual, linearised at some point.
    """
    out = []
    for trace, part, (lane, _, marks) in zip(
        problem.batch.traces, columns(problem.batch, here.r), problem.batch.places, strict=True
    ):
        for m in range(len(trace.channels)):
            seen = np.isfinite(trace.data[:, m])
            where = trace.test.name, trace.measurement.file
            discount = float(np.median(problem.sigma[marks[seen], lane, m])) / float(trace.sigma[m])
            out.append(Piece(*where, here.jacobian[marks[seen], lane, m], part[seen, m], discount))
    return tuple(out)
