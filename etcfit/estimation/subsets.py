"""The fit made again to some of its rig tests: same model, same whitening, same compiled programs, other weights."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, prior_residual_here
from ..problem.trace import Trace
from .levenberg_marquardt import descend
from .pieces import Piece, pieces_at
from .settings import FitSettings

_CLOSE = 1e-4  # relative change of chi2 that ends a descent: far less than parts that disagree differ by

_RENEWALS = 3  # of a subset's whitening


@dataclass(frozen=True, eq=False)
class Subset:
    """Where the fit goes on a part of the data.

    Args:
        tests: those that count.
        x: coordinates, shape (P,).
        pieces: every channel of every trace linearised there, those that do not count among them.
        belief: score of the priors there, shape (P,).
    """

    tests: tuple[str, ...]
    x: np.ndarray
    pieces: tuple[Piece, ...]
    belief: np.ndarray


def tests_of(problem: EstimationProblem) -> tuple[str, ...]:
    """Every rig test among the traces."""
    return tuple(dict.fromkeys(trace.test.name for trace in problem.batch.traces))


def fitted_to(
    problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, tests: Collection[str], settings: FitSettings
) -> Subset:
    """Descend from x with some tests alone.

    Args:
        problem, weighted: all the data, as they were fitted.
        x: the optimum of all, shape (P,).
        tests: those to count.
        settings: `steps`, the budget of the descent.
    """
    counts = muted(problem, weighted, lambda trace: trace.test.name in tests)
    end, _ = descend(problem, x, counts, _CLOSE, settings.steps)
    return at(problem, weighted, end, tests)


def renewed(problem: EstimationProblem, here: Subset, settings: FitSettings) -> Subset:
    """The fit to a subset with a whitening, and outliers, of its own.

    Those of all the data were made along the path that the test left out had bent. Sums of squares before and after
    are not comparable.

    Args:
        problem: all the data.
        here: the subset's fit under the whitening of all.
        settings: see `fitted_to`.
    """
    fresh = replace(problem, sigma=problem.batch.slots.sigma)
    for _ in range(_RENEWALS):
        here = fitted_to(fresh, fresh.weighted(fresh.kalman(here.x)), here.x, here.tests, settings)
    return here


def at(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, tests: Collection[str]) -> Subset:
    """All data linearised at x, shape (P,), of which some tests count."""
    return Subset(tuple(tests), x, pieces_at(problem, x, weighted), belief(problem, weighted, x))


def belief(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray) -> np.ndarray:
    """Score of the priors at x, (x - mean) / sd^2, shape (P,)."""
    own = prior_residual_here(problem.layout.padded(x), weighted) / np.asarray(weighted.prior_sd)
    return own[: x.size]


def muted(problem: EstimationProblem, weighted: WeightedData, counts: Callable[[Trace], bool]) -> WeightedData:
    """The data with the weights of all traces 0 but of those that count."""
    weight = np.array(weighted.whitening.weight)
    for trace, (lane, _, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        if not counts(trace):
            weight[marks, lane] = 0.0
    return weighted._replace(whitening=weighted.whitening._replace(weight=weight))
