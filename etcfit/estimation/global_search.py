"""A search that needs no gradient, for where the residual is too rough for one.

A model that lacks an effect sticks, slips and hits its stops at other samples than the plate did; its chi2 is then full
of small steps on which Levenberg-Marquardt stops. Points drawn about where it stopped find a lower chi2, or show that
there is none nearby.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..problem.chi2 import chi2_of
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .settings import GlobalSearchSettings

Cost = Callable[[np.ndarray], np.ndarray]  # what is minimised, of K points at once, shape (K, P) -> (K,)


def evolve(
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    spread: np.ndarray,
    settings: GlobalSearchSettings = GlobalSearchSettings(),
) -> np.ndarray:
    """`evolve_population` on the chi2 of a problem; coordinates of the best point, shape (P,)."""
    return evolve_population(lambda points: chi2_of(problem, points, weighted), x, spread, settings)


def evolve_population(
    cost: Cost, x: np.ndarray, spread: np.ndarray, settings: GlobalSearchSettings = GlobalSearchSettings()
) -> np.ndarray:
    """The best point of a population that begins about x and evolves by differential evolution.

        trial = u + F (best - u) + F (a - b),  or  c + F (a - b),    F ~ U(0.4, 0.9), nine tenths of its coordinates

    A trial takes the place of u where its cost is lower. Source: Storn and Price 1997, strategies current-to-best/1 and
    rand/1. Differs from source: each trial takes either strategy by chance, and F is drawn anew.

    Args:
        cost: what is minimised, positive.
        x: coordinates, shape (P,); one of the population, so the end is never worse.
        spread: standard deviations of the first population, coordinates, shape (P,).
        settings: budgets.
    Returns:
        coordinates, shape (P,).
    """
    rng = np.random.default_rng(settings.population_seed)
    size = settings.points
    crowd = x + spread * rng.standard_normal((size, x.size))
    crowd[0] = x
    price = cost(crowd)
    history = [float(price.min())]
    for epoch in range(settings.epochs):
        if epoch >= settings.patience and history[-1] > (1.0 - settings.least_gain) * history[-settings.patience]:
            break
        a, b, c = (crowd[rng.permutation(size)] for _ in range(3))
        step = rng.uniform(0.4, 0.9, (size, 1))
        greedy = crowd + step * (crowd[np.argmin(price)] - crowd) + step * (a - b)
        young = np.where(rng.uniform(size=(size, 1)) < 0.5, greedy, c + step * (a - b))
        young = np.where(rng.uniform(size=young.shape) < 0.9, young, crowd)
        asked = cost(young)
        better = asked < price
        crowd[better], price[better] = young[better], asked[better]
        history.append(float(price.min()))
    return crowd[int(np.argmin(price))]


def settle(
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    covariance: np.ndarray,
    unit: float,
    settings: GlobalSearchSettings = GlobalSearchSettings(),
) -> tuple[np.ndarray, float]:
    """`search_about` on the chi2 of a problem."""
    return search_about(lambda points: chi2_of(problem, points, weighted), x, covariance, unit, settings)


def search_about(
    cost: Cost,
    x: np.ndarray,
    covariance: np.ndarray,
    unit: float,
    settings: GlobalSearchSettings = GlobalSearchSettings(),
) -> tuple[np.ndarray, float]:
    """Move to the best of the points drawn about x, again and again, until none is worth it.

    The points are normal with the given covariance times the squares of `settings.radii`.

    Args:
        cost: what is minimised.
        x: coordinates, shape (P,).
        covariance: of the coordinates, in which the points are drawn, shape (P, P).
        unit: of the cost in which a gain counts; chi2 per degree of freedom, say.
        settings: budgets.
    Returns:
        coordinates of the end, shape (P,), and the last gain in those units: what a further move might still bring.
    """
    rng = np.random.default_rng(settings.draws_seed)
    spread, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(spread, 0.0))
    size = settings.points
    radius = np.repeat(settings.radii, size // len(settings.radii))[:, None]
    here = float(cost(np.tile(x, (size, 1)))[0])  # as many points as below: what is compiled serves again
    gain = 0.0
    for _ in range(settings.draws):
        points = x + radius * rng.standard_normal((size, x.size)) @ root.T
        price = cost(points)
        best = int(np.argmin(price))
        gain = max(0.0, here - float(price[best])) / unit
        if gain < settings.worth:
            break
        x, here = points[best], float(price[best])
    return x, gain
