"""How far each unit is from the population, by its own uncertainty and by how much units differ.

    d_u^2 = (x_u - mu)^T (F_u^-1 + Omega + C_u)^-1 (x_u - mu),   degrees of freedom: the rank of F_u

C_u is the covariance of the mean for a unit that took no part in it, else nothing. The spread is known from n units
only, so d^2 / k is compared with F(k, n) instead of chi2: exact for none, right to first order for few units. A unit
that is far in one symbol alone is better seen there, see `single_unit_distance`; p is twice the smaller of both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from .likelihood import weights
from .multiplicity import LEAST, null_scale
from .scaled import Scaled
from .settings import OddSettings
from .single_unit_distance import single_unit_distance


@dataclass(frozen=True, eq=False)
class Distances:
    """Of N units.

    Args:
        squared: d^2, shape (N,).
        rank: directions the unit informs, shape (N,).
        scale: of the null, see `null_scale`.
        p: that an ordinary unit is as far, in all symbols together or in any one alone, shape (N,); 1 where a unit
            informs nothing.
        alone: whether one symbol alone says so more clearly, shape (N,).
    """

    squared: Float[np.ndarray, " N"]
    rank: Float[np.ndarray, " N"]
    scale: float
    p: Float[np.ndarray, " N"]
    alone: Bool[np.ndarray, " N"]


def distances(
    data: Scaled, mean: np.ndarray, covariance: np.ndarray, of_mean: np.ndarray, inside: Bool[np.ndarray, " N"],
    settings: OddSettings,
) -> Distances:  # fmt: skip
    """Every unit's.

    Args:
        data: units.
        mean, covariance, of_mean: mu, Omega and C, scaled.
        inside: whether a unit took part in these.
        settings: of the null.
    """
    squared = np.zeros(len(data.x))
    for group, spread in ((inside, covariance), (~inside, covariance + of_mean)):
        if np.any(group):
            part = data.only(group)
            m, _ = weights(part, spread)
            error = np.einsum("ujk,uk->uj", part.root, part.x - mean)
            squared[group] = np.sum(error * np.linalg.solve(m, error[:, :, None])[:, :, 0], axis=1)
    k = np.maximum(data.rank, 1.0)
    p = np.where(data.rank > 0.0, stats.f.sf(squared / k, k, float(inside.sum())), 1.0)
    score = stats.norm.isf(0.5 * np.clip(p, LEAST, 1.0))
    told = data.rank > 0.0
    scale = null_scale(score[told], settings.tail) if np.any(told) else 1.0
    together = np.where(told, 2.0 * stats.norm.sf(score / scale), 1.0)
    apart = single_unit_distance(data, mean, np.diag(covariance), inside, settings.tail)
    return Distances(squared, data.rank, scale, np.minimum(1.0, 2.0 * np.minimum(together, apart)), apart < together)
