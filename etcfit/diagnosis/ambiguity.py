"""Effects that these data cannot tell apart: how far their fits are, and what not knowing which one does to parameters.

Each of two tied models may be the true one, so an interval must hold the value that either gives:

    C' = C + sum_t d_t d_t^T,    d_t = x_t - x of what both models fit

Source: Buckland, Burnham and Augustin 1997, Biometrics 53(2) (model uncertainty). Differs from source: the whole
difference is taken, not one weighted by the models' odds, which a tie leaves open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from .trial import CandidateModel


@dataclass(frozen=True)
class Apart:
    """How far the fit with another effect is from that with the one that stands in the model.

    Args:
        residual: rms over the samples, in units of the noise.
        moved: difference of each coordinate that both models fit, by symbol.
    """

    residual: float
    moved: Mapping[str, float]


def apart(other: CandidateModel, best: CandidateModel) -> Apart:
    """Two fits under the same whitening, side by side."""
    difference = other.problem.residual(other.x, other.weighted) - best.problem.residual(best.x, best.weighted)
    here, there = (dict(zip(s.problem.layout.free, s.x.tolist(), strict=True)) for s in (best, other))
    moved = {symbol: there[symbol] - here[symbol] for symbol in here.keys() & there.keys()}
    return Apart(float(np.sqrt(np.sum(difference**2) / best.weighted.samples)), moved)


def between(s: CandidateModel, ties: Iterable[Apart]) -> np.ndarray:
    """What not knowing which of the tied effects it is adds to the covariance of the coordinates, shape (P, P)."""
    out = np.zeros((s.x.size, s.x.size))
    for tie in ties:
        d = np.array([tie.moved.get(symbol, 0.0) for symbol in s.problem.layout.free])
        out += np.outer(d, d)
    return out
