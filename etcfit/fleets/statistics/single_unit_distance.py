"""How far each unit is from the others in one symbol alone, judged by a scatter that it has no part in.

    z_us = (x_us - mu_s) / sqrt(1/F_us + Omega_ss),   r = z / (s_z sqrt(1 - 1/n)),   t = r sqrt((n - 2) / (n - 1 - r^2))

t has n - 2 degrees of freedom. Among a dozen units one that is far off in one symbol widens the very spread that it is
measured by: its z cannot exceed (n - 1) / sqrt(n), and its distance over all symbols is diluted by those in which it is
like the others. t is what z would be had the unit been left out. A unit that took no part is compared with the n that
did, t = z / (s_z sqrt(1 + 1/n)), n - 1 degrees of freedom. s_z, near 1, takes up what stated errors are wrong by.

Source: Cook and Weisberg 1982, Residuals and Influence in Regression, section 2.2 (externally studentised residuals).
Differs from source: units weigh as they are known, for which n is first order.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from .multiplicity import LEAST, null_scale
from .scaled import Scaled

FEWEST = 4  # units that tell a symbol; of fewer none can be called far


def single_unit_distance(
    data: Scaled, mean: Float[np.ndarray, " P"], between: Float[np.ndarray, " P"], inside: Bool[np.ndarray, " N"],
    tail: float,
) -> Float[np.ndarray, " N"]:  # fmt: skip
    """Probability that an ordinary unit is as far in any of its symbols, shape (N,).

    Args:
        data: units.
        mean: mu, scaled.
        between: Omega's diagonal, scaled.
        inside: whether a unit took part in these.
        tail: see `multiplicity.null_scale`.
    """
    p = np.ones(data.x.shape)
    for s in range(data.x.shape[1]):
        told = data.tells[:, s]
        if (told & inside).sum() >= FEWEST:
            z = (data.x[told, s] - mean[s]) / np.sqrt(data.variance[told, s] + between[s])
            p[told, s] = _studentised(z, inside[told], tail)
    return np.minimum(1.0, np.maximum(data.tells.sum(axis=1), 1) * p.min(axis=1))


def _studentised(z: np.ndarray, inside: np.ndarray, tail: float) -> np.ndarray:
    n = int(inside.sum())
    scatter = np.sqrt(np.sum(z[inside] ** 2) / (n - 1)) or 1.0
    r2 = np.minimum((z / scatter) ** 2 / (1.0 - 1.0 / n), (n - 1) * (1.0 - 1e-12))
    within = np.sqrt(r2 * (n - 2) / (n - 1 - r2))
    p = np.where(
        inside, 2.0 * stats.t.sf(within, n - 2), 2.0 * stats.t.sf(np.abs(z) / scatter / np.sqrt(1.0 + 1.0 / n), n - 1)
    )
    score = stats.norm.isf(0.5 * np.clip(p, LEAST, 1.0))
    return 2.0 * stats.norm.sf(score / null_scale(score, tail))
