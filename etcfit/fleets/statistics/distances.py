"""How far each unit is from the population, how sure that is, and what many such tests at once are worth.

    d_u^2 = (x_u - mu)^T (F_u^-1 + Omega + C_u)^-1 (x_u - mu),   degrees of freedom: the rank of F_u

C_u is the covariance of the mean for a unit that took no part in it, else nothing. The spread is known from n units
only, so d^2 / k is compared with F(k, n) instead of chi2: exact for none, right to first order for few units. A unit
that is far in one symbol alone is better seen there, see `single_symbol_p`; p is twice the smaller of both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from .likelihood import weights
from .stack import Scaled

LEAST = 1e-300  # smaller p values count as this one
MANY = 100  # scores without which a quantile of the tail is noise
TAIL = 0.9  # quantile of the fleet's own scores that, beside the median, sets the scale of the null
FEWEST = 4  # units whose data determine a symbol; of fewer none can be called far


@dataclass(frozen=True, eq=False)
class Distances:
    """Of N units."""

    squared: Float[np.ndarray, " N"]  # d^2
    rank: Float[np.ndarray, " N"]  # directions the unit informs
    scale: float  # of the null, see `null_scale`
    # chance that an ordinary unit is as far, in all symbols or in any one, shape (N,); 1 where a unit informs nothing
    p: Float[np.ndarray, " N"]


def distances(
    data: Scaled, mean: np.ndarray, covariance: np.ndarray, of_mean: np.ndarray, inside: Bool[np.ndarray, " N"]
) -> Distances:
    """Every unit's, by mu, Omega and C, scaled; `inside`: whether a unit took part in these."""
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
    scale = null_scale(score[told]) if np.any(told) else 1.0
    together = np.where(told, 2.0 * stats.norm.sf(score / scale), 1.0)
    apart = single_symbol_p(data, mean, np.diag(covariance), inside)
    return Distances(squared, data.rank, scale, np.minimum(1.0, 2.0 * np.minimum(together, apart)))


def single_symbol_p(
    data: Scaled, mean: Float[np.ndarray, " P"], between: Float[np.ndarray, " P"], inside: Bool[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Probability that an ordinary unit is as far in any of its symbols, judged by a scatter it has no part in, (N,).

        z_us = (x_us - mu_s) / sqrt(1/F_us + Omega_ss),  r = z / (s_z sqrt(1 - 1/n)),  t = r sqrt((n - 2)/(n - 1 - r^2))

    t has n - 2 degrees of freedom. Among a dozen units one that is far off in one symbol widens the very spread that it
    is measured by: its z cannot exceed (n - 1) / sqrt(n), and its distance over all symbols is diluted by those in
    which it is like the others. t is what z would be had the unit been left out. A unit that took no part is compared
    with the n that did, t = z / (s_z sqrt(1 + 1/n)), n - 1 degrees of freedom. s_z, near 1, takes up what stated errors
    are wrong by.

    Source: Cook and Weisberg 1982, Residuals and Influence in Regression, section 2.2 (externally studentised
    residuals). Differs from source: units weigh as they are known, for which n is first order.
    """
    p = np.ones(data.x.shape)
    for s in range(data.x.shape[1]):
        told = data.tells[:, s]
        if (told & inside).sum() >= FEWEST:
            z = (data.x[told, s] - mean[s]) / np.sqrt(data.variance[told, s] + between[s])
            p[told, s] = _studentised(z, inside[told])
    return np.minimum(1.0, np.maximum(data.tells.sum(axis=1), 1) * p.min(axis=1))


def _studentised(z: np.ndarray, inside: np.ndarray) -> np.ndarray:
    n = int(inside.sum())
    scatter = np.sqrt(np.sum(z[inside] ** 2) / (n - 1)) or 1.0
    r2 = np.minimum((z / scatter) ** 2 / (1.0 - 1.0 / n), (n - 1) * (1.0 - 1e-12))
    within = np.sqrt(r2 * (n - 2) / (n - 1 - r2))
    p = np.where(
        inside, 2.0 * stats.t.sf(within, n - 2), 2.0 * stats.t.sf(np.abs(z) / scatter / np.sqrt(1.0 + 1.0 / n), n - 1)
    )
    score = stats.norm.isf(0.5 * np.clip(p, LEAST, 1.0))
    return 2.0 * stats.norm.sf(score / null_scale(score))


def null_scale(score: Float[np.ndarray, " N"], tail: float = TAIL) -> float:
    """How much wider than N(0, 1) the scores of the ordinary units are, at least 1.

        max(1, median |z| / 0.6745, quantile_tail |z| / the normal's)

    Covariances of fits are not exact and errors have tails. Most units are ordinary, so the fleet's own middle says how
    scores are distributed where nothing is odd: the median for the scale, a higher quantile for the tail. Never below
    1: where the stated covariances are too wide, nothing is made odd by that.

    Args:
        score: standard normal if all were as in the book, either sign; at least one.
        tail: quantile of |score|; used for 100 scores or more, as a few odd ones reach into that of a dozen.
    """
    size = np.abs(score)
    wide = float(np.median(size)) / stats.norm.ppf(0.75)
    if len(size) >= MANY:
        wide = max(wide, float(np.quantile(size, tail)) / stats.norm.ppf(0.5 + 0.5 * tail))
    return float(max(1.0, wide))


def rejected(p: Float[np.ndarray, " N"], rate: float) -> Bool[np.ndarray, " N"]:
    """Hypotheses rejected so that a share `rate` of them is false, as expected: Benjamini and Hochberg 1995."""
    return stats.false_discovery_control(p) <= rate


def holm(p: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """p values that hold for all N at once, under any dependence: Holm 1979."""
    order = np.argsort(p)
    out = np.empty(len(p))
    out[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return out
