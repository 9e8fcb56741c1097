"""Errors of many traces as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..problem.prediction_error import PredictionError, pooled


@dataclass(frozen=True)
class Pool:
    """Root mean squares over traces, each counting for its samples.

        rms^2 = sum n_k rms_k^2 / sum n_k,    likewise sigma and ratio = rms / sigma

    Args:
        traces, samples: how many.
        rms, sigma: in the unit of the rows.
        ratio: of rms and sigma, row by row.
    """

    traces: int
    samples: int
    rms: float
    sigma: float
    ratio: float

    @classmethod
    def of(cls, rows: Sequence[PredictionError]) -> Pool:
        """Rows of one unit; of several units only the ratio means anything."""
        n = np.array([row.n for row in rows], dtype=float)

        def mean(values: list[float]) -> float:
            return float(np.sqrt(np.sum(n * np.array(values) ** 2) / n.sum()))

        rms, sigma = mean([row.rms for row in rows]), mean([row.sigma for row in rows])
        return cls(len(rows), int(n.sum()), rms, sigma, pooled(rows))


def grouped(rows: Sequence[PredictionError]) -> dict[tuple[str, str, str], list[PredictionError]]:
    """Rows by test, channel and unit, in the order in which these come."""
    groups: dict[tuple[str, str, str], list[PredictionError]] = {}
    for row in rows:
        groups.setdefault((row.test, row.channel, row.unit), []).append(row)
    return groups
