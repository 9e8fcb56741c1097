"""The covariance between units as numbers that may take any value: standard deviations and correlations.

    Omega = D C C^T D,   D = diag(d),   row j of C = (a_j1, ..., a_j,j-1, 1, 0, ...) / norm

|d_j| is a standard deviation and C C^T the correlation matrix, whatever a is: no bound is ever hit, d_j = 0 is an
ordinary point, and a profile over one standard deviation is an ordinary fit with d_j held. Shared symbols have no d.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class Spread:
    """A covariance between units.

    Args:
        own: whether a symbol differs between units, shape (P,).
        d: of those Q that do, shape (Q,).
        a: the strictly lower triangle, row by row, shape (Q (Q - 1) / 2,).
    """

    own: Bool[np.ndarray, " P"]
    d: Float[np.ndarray, " Q"]
    a: Float[np.ndarray, " A"]

    @property
    def vector(self) -> Float[np.ndarray, " K"]:
        """(d, a)."""
        return np.concatenate([self.d, self.a])

    def at(self, vector: Float[np.ndarray, " K"]) -> Spread:
        """Of the same symbols."""
        return Spread(self.own, vector[: len(self.d)], vector[len(self.d) :])

    @property
    def uncorrelated(self) -> Spread:
        """With the same standard deviations."""
        return Spread(self.own, self.d, np.zeros_like(self.a))

    @cached_property
    def rows(self) -> Float[np.ndarray, "Q Q"]:
        """C: rows of length one."""
        full = np.eye(len(self.d))
        full[np.tril_indices(len(self.d), -1)] = self.a
        return full / np.sqrt(np.sum(full**2, axis=1, keepdims=True))

    @property
    def covariance(self) -> Float[np.ndarray, "P P"]:
        """Omega, with zeros for shared symbols."""
        out = np.zeros((len(self.own), len(self.own)))
        root = self.d[:, None] * self.rows
        out[np.ix_(self.own, self.own)] = root @ root.T
        return out

    @property
    def slopes(self) -> Float[np.ndarray, "K Q Q"]:
        """dOmega / d(d, a) of the symbols that differ."""
        size = len(self.d)
        rows = self.rows
        out = np.zeros((size + len(self.a), size, size))
        turned = rows @ (self.d[:, None] * rows).T  # row j: c_j^T L^T
        for j in range(size):
            out[j, j] += turned[j]
            out[j, :, j] += turned[j]
        row, column = np.tril_indices(size, -1)
        norm = 1.0 / np.diag(rows)  # of row j before it was scaled, as its last entry was 1
        for k, (j, m) in enumerate(zip(row, column, strict=True)):
            change = -rows[j] * rows[j, m] / norm[j]
            change[m] += 1.0 / norm[j]
            effect = self.d[j] * change @ (self.d[:, None] * rows).T
            out[size + k, j] += effect
            out[size + k, :, j] += effect
        return out
