"""Effects that these data cannot tell apart: how far their fits are, and what not knowing which one does to parameters.

Each of two tied models may be the true one, so an interval must hold the value that either gives:

    C' = C + sum_t d_t d_t^T,    d_t = x_t - x of what both models fit

Source: Buckland, Burnham and Augustin 1997, Biometrics 53(2) (model uncertainty). Differs from source: the whole
difference is taken, not one weighted by the models' odds, which a tie leaves open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .candidate_model import CandidateModel


@dataclass(frozen=True)
class Apart:
    """How far the fit with another effect is from the fit with the one that was added.

    Args:
        residual: rms over the samples, in units of the noise.
        moved: difference of each coordinate that both models fit, by symbol.
    """

    residual: float
    moved: Mapping[str, float]


def apart(other: CandidateModel, best: CandidateModel) -> Apart:
    """Two models under one whitening, side by side."""
    difference = other.problem.residual(other.x, other.weighted) - best.problem.residual(best.x, best.weighted)
    here, there = (dict(zip(s.problem.layout.free, s.x.tolist(), strict=True)) for s in (best, other))
    return Apart(distance(difference, best.weighted.samples), moved(there, here))


def distance(difference: np.ndarray, samples: float) -> float:
    """sqrt(sum d^2 / n) of two whitened residuals' difference d, shape (T, L, M), with n samples among its entries."""
    return float(np.sqrt(np.sum(difference**2) / samples))


def moved(there: Mapping[str, float], here: Mapping[str, float]) -> dict[str, float]:
    """x_t - x of each coordinate that both models fit, by symbol."""
    return {symbol: there[symbol] - here[symbol] for symbol in here.keys() & there.keys()}


def between(free: Sequence[str], ties: Iterable[Apart]) -> np.ndarray:
    """sum_t d_t d_t^T: what not knowing which of the tied effects it is adds to the covariance of the coordinates.

    Args:
        free: symbols of the coordinates, P of them; what a tied model does not fit counts as not moved.
        ties: the tied models.
    Returns:
        shape (P, P).
    """
    out = np.zeros((len(free), len(free)))
    for tie in ties:
        d = np.array([tie.moved.get(symbol, 0.0) for symbol in free])
        out += np.outer(d, d)
    return out
