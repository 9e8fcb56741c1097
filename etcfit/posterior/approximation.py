"""A normal density near the one that is sampled: from it walkers begin, and by it they leap.

    x_i ~ t_10(m, C),    w_i = (p(x_i) / t_10(x_i | m, C))^b,    m, C: mean and covariance of the x_i weighted by w_i

again and again, each time from the last m and C, until b = 1. The power b <= 1 is the largest that leaves the weights
of enough draws alike: it is small where the first m and C are poor, and rises as they become better.

The curvature at the mode alone does not do. Where a parameter lies on its bound it is 0; where plate and friction stick
and slip the density is rough, and its curvature at one point says little of its width.

Source: Cappe, Guillin, Marin and Robert 2004 (population Monte Carlo); powers of the weights: Koblents and Miguez 2015.
Differs from source: one t distribution, not a mixture.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .settings import SamplingSettings

LogProbability = Callable[[np.ndarray], np.ndarray]

FREEDOM = 10.0  # degrees of freedom of t
_HALVINGS = 40  # of the range in which the power lies


class Approximation(NamedTuple):
    """A normal density over coordinates.

    Args:
        mean: shape (P,).
        root: square root of the covariance, shape (P, P).
    """

    mean: np.ndarray
    root: np.ndarray


def log_t(u: np.ndarray) -> np.ndarray:
    """log density of a standard multivariate t, to a constant, shape (K, P) -> (K,)."""
    return -0.5 * (FREEDOM + u.shape[1]) * np.log1p(np.sum(u**2, axis=1) / FREEDOM)


def drawn_t(count: int, size: int, random: np.random.RandomState) -> np.ndarray:
    """Draws of a standard multivariate t, shape (count, size)."""
    scale = np.sqrt(FREEDOM / random.chisquare(FREEDOM, count))
    return scale[:, None] * random.standard_normal((count, size))


def root_of(covariance: np.ndarray) -> np.ndarray:
    """A square root of a covariance, shape (P, P)."""
    variance, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(variance, 0.0))


def approximate(
    target: LogProbability,
    mean: np.ndarray,
    covariance: np.ndarray,
    settings: SamplingSettings = SamplingSettings(),
) -> Approximation:
    """The normal density of the target's own mean and covariance, as far as they are found.

    Args:
        target: log-probability of coordinates, shape (K, P) -> (K,).
        mean: first guess, shape (P,).
        covariance: first guess, shape (P, P).
        settings: how many draws, how often, and how alike their weights must be; the first seed.
    """
    random = np.random.RandomState(settings.seeds[0])
    here, count = Approximation(mean, root_of(covariance)), settings.draws_per_coordinate * mean.size
    for _ in range(settings.most_rounds):
        here, power = _improved(target, here, count, settings.alike_weights, random)
        if power == 1.0:
            return _improved(target, here, settings.refinement * count, settings.alike_weights, random)[0]
    return here


def _improved(
    target: LogProbability, here: Approximation, count: int, alike: float, random: np.random.RandomState
) -> tuple[Approximation, float]:
    """Mean and covariance of so many weighted draws, and the power of their weights; what was there, and 0, where none
    of them has any density."""
    u = drawn_t(count, here.mean.size, random)
    log_weight = target(here.mean + u @ here.root.T) - log_t(u)
    if not np.isfinite(log_weight).any():
        return here, 0.0
    power = _power(log_weight, alike * count)
    weight = _weights(log_weight, power)
    middle = weight @ u
    spread = (weight[:, None] * (u - middle)).T @ (u - middle) / (1.0 - weight @ weight)
    return Approximation(here.mean + here.root @ middle, here.root @ root_of(spread)), power


def _weights(log_weight: np.ndarray, power: float) -> np.ndarray:
    """Weights to a power, their sum 1."""
    weight = np.exp(power * (log_weight - np.max(log_weight)))
    return weight / np.sum(weight)


def _power(log_weight: np.ndarray, count: float) -> float:
    """The largest power, at most 1, of weights that are worth at least so many equal ones."""

    def is_enough(power: float) -> bool:
        return 1.0 / float(np.sum(_weights(log_weight, power) ** 2)) >= count

    if is_enough(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_enough(middle) else (low, middle)
    return low
