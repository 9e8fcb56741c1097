"""A fleet in numbers of the order of one: each symbol less its centre, over its scale; information by its square root.

    F_u = S^-1 H_u^T H_u S^-1,   x_u = S^-1 (estimate_u - centre)

H_u has a zero row for every direction that the unit does not inform. All below is written with H and x, so that a
direction without information takes part with weight nought, and a strong one loses no digits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from .stack import Stack

MEDIAN_CHI2 = 0.4549364231195724  # of one degree of freedom


@dataclass(frozen=True, eq=False)
class Scaled:
    """N units and P symbols without units of measure.

    Args:
        stack: what it is made from.
        centre: robust, SI, shape (P,).
        scale: SI, shape (P,).
        root: H, shape (N, P, P).
        x: shape (N, P).
        rank: directions that each unit informs, shape (N,).
        tells: whether a unit's data alone tell a symbol, shape (N, P).
        variance: of its own estimate then, marginal, infinite where it tells nothing, shape (N, P).
        spread: robust standard deviation between units, symbol by symbol, shape (P,).
    """

    stack: Stack
    centre: Float[np.ndarray, " P"]
    scale: Float[np.ndarray, " P"]
    root: Float[np.ndarray, "N P P"]
    x: Float[np.ndarray, "N P"]
    rank: Float[np.ndarray, " N"]
    tells: Bool[np.ndarray, "N P"]
    variance: Float[np.ndarray, "N P"]
    spread: Float[np.ndarray, " P"]

    def only(self, kept: Bool[np.ndarray, " N"]) -> Scaled:
        """Those units alone, in the same scale."""
        arrays = (self.root[kept], self.x[kept], self.rank[kept], self.tells[kept], self.variance[kept])
        return Scaled(self.stack.only(kept), self.centre, self.scale, *arrays, self.spread)

    @property
    def marginal(self) -> Scaled:
        """Each symbol of each unit for itself, known to its variance when nothing is known of the others."""
        return replace(self, root=np.eye(self.x.shape[1]) / np.sqrt(self.variance)[:, None, :])


def scaled(stack: Stack, null: float) -> Scaled:
    """Centre and scale are medians over the units that tell a symbol: no odd unit moves them.

    Args:
        stack: units.
        null: share of the largest eigenvalue below which a direction has no information.
    """
    diagonal = np.einsum("upp->up", stack.information)
    own = np.array([1.0 / np.sqrt(np.median(d[d > 0.0])) if np.any(d > 0.0) else 1.0 for d in diagonal.T])
    root, rank, tells, variance = _roots(stack.information * own[:, None] * own[None, :], null)
    size = len(stack.symbols)
    centre, spread, wide = np.zeros(size), np.zeros(size), np.ones(size)
    for p in range(size):
        seen = tells[:, p] if np.any(tells[:, p]) else diagonal[:, p] > 0.0
        if not np.any(seen):
            continue
        value = stack.estimate[seen, p]
        noise = own[p] ** 2 * np.where(tells[seen, p], variance[seen, p], 1.0)
        # the half whose own estimates are best says where the middle is
        centre[p] = np.median(value[noise <= np.median(noise)])
        spread[p] = _between(value - np.median(value), noise)
        wide[p] = np.hypot(spread[p], np.sqrt(np.median(noise)))
    ratio = wide / own
    return Scaled(stack, centre, wide, root * ratio, (stack.estimate - centre) / wide, rank, tells,
                  variance / ratio**2, spread / wide)  # fmt: skip


def _roots(f: np.ndarray, null: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """H, rank, what is told, and the marginal variance, of information (N, P, P) with diagonals near one."""
    d = np.einsum("upp->up", f)
    s = np.sqrt(np.where(d > 0.0, d, 1.0))  # each unit by its own diagonal, that one good symbol hides no weak one
    value, vector = np.linalg.eigh(f / (s[:, :, None] * s[:, None, :]))
    good = value > null * np.maximum(value[:, -1:], 1e-300)
    root = np.sqrt(np.where(good, value, 0.0))[:, :, None] * np.swapaxes(vector, 1, 2) * s[:, None, :]
    inside = np.sum(np.where(good[:, None, :], vector**2, 0.0), axis=2)
    tells = inside > 1.0 - 1e-6
    inverse = np.where(good, 1.0 / np.where(good, value, 1.0), 0.0)
    variance = np.where(tells, np.sum(vector**2 * inverse[:, None, :], axis=2) / s**2, np.inf)
    return root, good.sum(axis=1).astype(float), tells, variance


def _between(error: np.ndarray, noise: np.ndarray) -> float:
    """The sd for which median(error^2 / (sd^2 + noise)) is that of chi2 with one degree of freedom; 0 where below."""
    high = 10.0 * float(np.max(np.abs(error))) + 1e-300
    if np.median(error**2 / noise) <= MEDIAN_CHI2:
        return 0.0
    low = 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.median(error**2 / (middle**2 + noise)) > MEDIAN_CHI2 else (low, middle)
    return 0.5 * (low + high)
