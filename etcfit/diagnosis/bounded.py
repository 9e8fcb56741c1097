"""Amplitudes that no bound forbids: ONE least-squares problem for the score test of one effect and of two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear

from ..model.parameters import AbstractDomain, NonNegative

_RIDGE = 1e-5  # ridge on amplitudes, their columns of length 1: keeps one that only adds to another's at rest


def lowest(domains: Sequence[AbstractDomain]) -> np.ndarray:
    """The least value of each amplitude over its scale, shape (k,): 0, or none."""
    return np.array([0.0 if isinstance(domain, NonNegative) else -np.inf for domain in domains])


def bounded(columns: np.ndarray, target: np.ndarray, low: np.ndarray) -> np.ndarray:
    """argmin |C a - t|^2 over a >= low, shape (k,).

    Args:
        columns: C, each of length 1, shape (n, k).
        target: t, shape (n,).
        low: shape (k,).
    """
    rows = np.vstack((columns, _RIDGE * np.eye(low.size)))
    right = np.concatenate((target, np.zeros(low.size)))
    return np.asarray(lsq_linear(rows, right, bounds=(low, np.inf), method="bvls").x)
