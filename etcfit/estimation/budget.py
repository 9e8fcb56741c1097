"""The uncertainty budget: which source makes which share of an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Budget:
    """Where the uncertainty of the parameters comes from.

    Args:
        sources: what is uncertain, in words: "scale of current", "zero of position", "gear ratio".
        moves: by how much one standard deviation of each moves the coordinates, shape (S, P).
        statistical: covariance of the coordinates without them, shape (P, P).
    """

    sources: tuple[str, ...]
    moves: np.ndarray
    statistical: np.ndarray

    def shares(self) -> np.ndarray:
        """Share of each parameter's variance that each source makes, the statistical one last, shape (S + 1, P)."""
        parts = np.vstack((self.moves**2, np.maximum(np.diag(self.statistical), 0.0)))
        return parts / np.maximum(parts.sum(axis=0), 1e-300)
