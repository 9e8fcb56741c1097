"""A search that needs no gradient, for where the residual is too rough for one.

A model that lacks an effect sticks, slips and hits its stops at other samples than the plate did; its chi2 is then full
of small steps on which Levenberg-Marquardt comes to rest. Points drawn about where it rests find the way on, or show
that there is none.
"""

from __future__ import annotations

import numpy as np

from ..problem.chi2 import chi2_of
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData

_DRAWS = 64
_GENERATIONS = 30
_EPOCHS = 120
_PATIENCE = 25  # epochs after which a population that gains less
_GAIN = 0.01  # than this share of chi2 has found what it will
_WORTH = 0.02  # chi2, in units of chi2 per degree of freedom, that makes a move worth it


def evolve(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, spread: np.ndarray) -> np.ndarray:
    """The best point of a population that starts about x and evolves (Storn and Price 1997, current-to-best and rand).

    Args:
        problem, weighted: the residual.
        x: coordinates, shape (P,); one of the population, so the end is never worse.
        spread: standard deviations of the first population, shape (P,).
    """
    rng = np.random.default_rng(11)
    crowd = x + spread * rng.standard_normal((_DRAWS, x.size))
    crowd[0] = x
    cost = chi2_of(problem, crowd, weighted)
    history = [float(cost.min())]
    for epoch in range(_EPOCHS):
        if epoch >= _PATIENCE and history[-1] > (1.0 - _GAIN) * history[-_PATIENCE]:
            break
        a, b, c = (crowd[rng.permutation(_DRAWS)] for _ in range(3))
        step = rng.uniform(0.4, 0.9, (_DRAWS, 1))
        greedy = crowd + step * (crowd[np.argmin(cost)] - crowd) + step * (a - b)
        young = np.where(rng.uniform(size=(_DRAWS, 1)) < 0.5, greedy, c + step * (a - b))
        young = np.where(rng.uniform(size=young.shape) < 0.9, young, crowd)
        price = chi2_of(problem, young, weighted)
        better = price < cost
        crowd[better], cost[better] = young[better], price[better]
        history.append(float(cost.min()))
    return crowd[int(np.argmin(cost))]


def settle(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, covariance: np.ndarray, unit: float
) -> tuple[np.ndarray, float]:
    """Move to the best of the points drawn about x, again and again, until none is worth it.

    Args:
        problem, weighted: the residual.
        x: coordinates, shape (P,).
        covariance: of the coordinates, in which the points are drawn, shape (P, P).
        unit: chi2 per degree of freedom, the unit in which a gain counts.
    Returns:
        where it ended, and the last gain in those units: what a further move might still bring.
    """
    rng = np.random.default_rng(7)
    spread, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(spread, 0.0))
    radius = np.repeat([1.0, 0.3, 0.1, 0.03], _DRAWS // 4)[:, None]
    here = float(chi2_of(problem, np.tile(x, (_DRAWS, 1)), weighted)[0])
    gain = 0.0
    for _ in range(_GENERATIONS):
        points = x + radius * rng.standard_normal((_DRAWS, x.size)) @ root.T
        chi2 = chi2_of(problem, points, weighted)
        best = int(np.argmin(chi2))
        gain = max(0.0, here - float(chi2[best])) / unit
        if gain < _WORTH:
            break
        x, here = points[best], float(chi2[best])
    return x, gain
