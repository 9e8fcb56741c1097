"""Posterior predictive bands: what each trace ought to have shown, and how much of it did.

    y_k ~ N(mean_k, var over draws of y_hat_k + C P_k C^T + sigma^2)

y_hat is the free-running simulation at draws of the posterior, P what the noise of the logged input and instants that
nobody logged add up to along it (`innovations.free_run_variance`), sigma the sensor's noise; of a fit that is `far`
from the data, the error left in each fitted channel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..estimation.intervals import Z_95
from ..estimation.joint_fit import Report, quiet
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from .sampling import Posterior


@dataclass(frozen=True, eq=False)
class Band:
    """The prediction of one trace, SI.

    Args:
        trace: as measured.
        mean, sd: shape (n, M).
    """

    trace: Trace
    mean: np.ndarray
    sd: np.ndarray

    @property
    def inside(self) -> tuple[float, ...]:
        """Share of each channel's samples inside its 95 % band."""
        error = np.abs(self.trace.data - self.mean)
        return tuple(float(np.mean(e[np.isfinite(e)] <= Z_95 * s[np.isfinite(e)]))
                     for e, s in zip(error.T, self.sd.T, strict=True))  # fmt: skip


def bands(posterior: Posterior, report: Report = quiet) -> tuple[Band, ...]:
    """Of every trace, fitted ones first, then those held out."""
    points = posterior.some(posterior.settings.predictive_draws)
    problems = [problem for problem in (posterior.fit.problem, posterior.fit.holdout) if problem is not None]
    out: list[Band] = []
    for k, problem in enumerate(problems):
        report("predictive bands", k / len(problems))
        out += _bands(problem, points, posterior.target.mode)
    return tuple(out)


def _bands(problem: EstimationProblem, points: np.ndarray, mode: np.ndarray) -> list[Band]:
    runs = [problem.free_run(x) for x in points]
    own = problem.free_run_variance(mode)
    drawn = [(np.mean(y, axis=0), np.var(y, axis=0)) for y in zip(*runs, strict=True)]
    return [Band(trace, mean, np.sqrt(spread + noise))
            for trace, (mean, spread), noise in zip(problem.batch.traces, drawn, own, strict=True)]  # fmt: skip
