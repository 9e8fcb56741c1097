"""What effects that act in the throttle do to the residual of a model without them, each by the cheapest way."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .along_path import serves, tangents_along_path
from .candidate_model import CandidateModel
from .composition import Effect
from .screen import Variant, in_groups, tangents

_Columns = dict[Variant, np.ndarray]


def tangents_inside(s: CandidateModel, every: Sequence[Variant]) -> list[np.ndarray]:
    """For each variant the derivative of the fitted samples' residual in each amplitude over its scale, (n, k).

    Along the path of the model where an effect acts as an input; for the others some models are made that have a few of
    them in it.

    Args:
        s: the model, at its optimum.
        every: variants of candidates that act in the throttle and are not at work.
    """
    along = [v for v in every if serves(s.problem, v.effect)]
    others = [v for v in every if not serves(s.problem, v.effect)]
    found = _in_groups(s, others) if others else {}
    if along:
        found |= dict(zip(along, tangents_along_path(s.problem, s.x, s.weighted, along), strict=True))
    return [found[v] for v in every]


def _in_groups(s: CandidateModel, every: Sequence[Variant]) -> _Columns:
    """Some groups side by side, for each compiles a model."""

    def columns(group: tuple[Effect, ...]) -> _Columns:
        asked = [v for v in every if v.effect in group]
        if not asked:
            return {}
        whole = s.composed(group)
        return dict(zip(asked, tangents(whole.problem, whole.x, whole.weighted, asked), strict=True))

    # of all candidates, those at work too: so the groups are the same in every round, and their programs found again
    groups = in_groups([e for e in s.composition.inside if not serves(s.problem, e)])
    with ThreadPoolExecutor(s.settings.refits_side_by_side) as pool:
        return {v: c for found in pool.map(columns, groups) for v, c in found.items()}
