"""Where no trace is held out: leave traces out in turn, refit without them, score on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..estimation.levenberg_marquardt import minimise
from ..problem.chi2 import chi2_of
from ..problem.cores import concurrently
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel


def groups_of(moving: Sequence[int], folds: int) -> list[list[int]]:
    """Traces left out together: dealt out one by one to `folds` groups; none where fewer than two move.

    Args:
        moving: numbers of the traces in which the plate moves.
        folds: most groups.
    """
    if len(moving) < 2:
        return []
    return [list(moving[start::folds]) for start in range(min(folds, len(moving)))]


def folds(s: CandidateModel) -> list[np.ndarray]:
    """Samples left out together, in turn: 1 in a mask of shape (T, L), 0 elsewhere; traces of a held plate never."""
    moving = [k for k, t in enumerate(s.problem.batch.traces) if not t.test.boundary.plate_held]
    return [_mask(s, group) for group in groups_of(moving, s.settings.folds)]


def _mask(s: CandidateModel, group: Sequence[int]) -> np.ndarray:
    batch = s.problem.batch
    mask = np.zeros(batch.steps.dt.shape)
    for k in group:
        lane, row, marks = batch.places[k]
        mask[row : marks[-1] + 1, lane] = 1.0
    return mask


def only(weighted: WeightedData, mask: np.ndarray) -> WeightedData:
    """Samples outside the mask, shape (T, L), get weight 0; all else stays."""
    keep = mask[..., None]
    slots = weighted.slots._replace(weight=weighted.slots.weight * keep)
    return weighted._replace(
        slots=slots, whitening=weighted.whitening._replace(weight=weighted.whitening.weight * keep)
    )


def refitted_without(s: CandidateModel, mask: np.ndarray) -> np.ndarray:
    """Coordinates, shape (P,), of the model refitted to the samples outside the mask, shape (T, L)."""
    return minimise(s.problem, s.x, only(s.weighted, 1.0 - mask), s.settings.fold_tolerance)[0]


def chi2_within(s: CandidateModel, x: np.ndarray, mask: np.ndarray) -> float:
    """chi2 of the samples in the mask, shape (T, L), at coordinates x, shape (P,); priors included."""
    return float(chi2_of(s.problem, x[None], only(s.weighted, mask))[0])


def left_out(s: CandidateModel) -> float:
    """chi2 of all traces that move, each group predicted by the model refitted without it.

    Models under one whitening compare; where there are too few traces to leave any out, it is 0 for all.
    """
    return sum(concurrently(lambda mask: chi2_within(s, refitted_without(s, mask), mask), folds(s)))
