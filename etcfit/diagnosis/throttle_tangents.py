"""What effects that act in the throttle do to the residual of a model without them, each by the cheapest way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from .along_path import serves, tangents_along_path
from .candidate_model import CandidateModel
from .composition import Effect
from .screen import Variant, in_groups, tangents

Made = TypeVar("Made")


def tangents_inside(
    s: CandidateModel, every: Sequence[Variant], use: Callable[[Variant, np.ndarray], Made]
) -> list[Made]:
    """For each variant what `use` makes of the derivative of the fitted samples' residual in each amplitude over its
    scale, (n, k): all of them side by side would take much memory.

    Along the path of the model where an effect acts as an input; for the others some models are made that have a few of
    them in it.

    Args:
        s: the model, at its optimum.
        every: variants of candidates that act in the throttle and are not at work.
        use: called by several threads.
    """
    along = [v for v in every if serves(s.problem, v.effect)]
    others = [v for v in every if not serves(s.problem, v.effect)]
    found = _in_groups(s, others, use) if others else {}
    if along:
        found |= dict(zip(along, tangents_along_path(s.problem, s.x, s.weighted, along, use), strict=True))
    return [found[v] for v in every]


def _in_groups(
    s: CandidateModel, every: Sequence[Variant], use: Callable[[Variant, np.ndarray], Made]
) -> dict[Variant, Made]:
    """Some groups side by side, for each compiles a model."""

    def of(group: tuple[Effect, ...]) -> dict[Variant, Made]:
        asked = [v for v in every if v.effect in group]
        if not asked:
            return {}
        whole = s.composed(group)
        columns = tangents(whole.problem, whole.x, whole.weighted, asked)
        return dict(zip(asked, map(use, asked, columns), strict=True))

    # of all candidates, those at work too: so the groups are the same in every round, and their programs found again
    groups = in_groups([e for e in s.composition.inside if not serves(s.problem, e)])
    with ThreadPoolExecutor(s.settings.refits_side_by_side) as pool:
        return {v: made for found in pool.map(of, groups) for v, made in found.items()}
