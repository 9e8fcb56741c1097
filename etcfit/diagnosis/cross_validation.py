"""Where no trace is held out: leave traces out in turn, refit without them, score on them."""

from __future__ import annotations

import numpy as np

from ..estimation.levenberg_marquardt import minimise
from ..problem.chi2 import chi2_of
from ..problem.residual import WeightedData
from .trial import CandidateModel

_FOLDS = 3
_TOLERANCE = 1e-3  # relative change of chi2 that ends a refit on part of the traces


def folds(s: CandidateModel) -> list[np.ndarray]:
    """Traces left out together, in turn: those in which the plate moves, dealt out one by one; masks (T, L)."""
    batch = s.problem.batch
    moving = [k for k, t in enumerate(batch.traces) if not t.test.boundary.plate_held]
    groups = [moving[start::_FOLDS] for start in range(min(_FOLDS, len(moving)))]
    return [_mask(s, group) for group in groups] if len(moving) > 1 else []


def _mask(s: CandidateModel, group: list[int]) -> np.ndarray:
    batch = s.problem.batch
    mask = np.zeros(batch.steps.dt.shape)
    for k in group:
        lane, row, marks = batch.places[k]
        mask[row : marks[-1] + 1, lane] = 1.0
    return mask


def _only(weighted: WeightedData, mask: np.ndarray) -> WeightedData:
    """The same with the samples outside the mask unseen."""
    keep = mask[..., None]
    slots = weighted.slots._replace(weight=weighted.slots.weight * keep)
    return weighted._replace(
        slots=slots, whitening=weighted.whitening._replace(weight=weighted.whitening.weight * keep)
    )


def _of_fold(s: CandidateModel, mask: np.ndarray) -> float:
    """chi2 of the traces in the mask for the model refitted on the others."""
    x, _ = minimise(s.problem, s.x, _only(s.weighted, 1.0 - mask), _TOLERANCE)
    return float(chi2_of(s.problem, x[None], _only(s.weighted, mask))[0])


def left_out(s: CandidateModel) -> float:
    """chi2 of all that moves, each trace predicted by the model refitted without it and those left out with it.

    Models under the same whitening compare; where there are too few traces to leave any out, it is 0 for all.
    """
    return sum(_of_fold(s, mask) for mask in folds(s))
