"""Intervals of the final model that allow for what is left in its residual, see `random_curves`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.joint_fit import Report
from ..estimation.levenberg_marquardt import believed
from ..estimation.remedies import listed
from ..estimation.result import FitResult
from ..model.smooth import AbstractSmooth
from .candidate_model import CandidateModel
from .findings import Discrepancy
from .random_curves import Bend, Curve, bend
from .screen import fitted_samples, variants
from .throttle_tangents import tangents_inside
from .unexplained import curves, widened


@dataclass(frozen=True, eq=False)
class Allowed:
    """A fit whose intervals allow for what is left, and what that may be."""

    after: FitResult
    found: tuple[Discrepancy, ...] = ()


def allowing_for_the_rest(result: FitResult, after: FitResult, s: CandidateModel, report: Report) -> Allowed:
    """The final fit with intervals that allow for curves which nobody added; itself where none is needed.

    Far from the data it is a compromise anyway, and there is no noise to measure what is left by.

    Args:
        result: the first fit.
        after: the fit of the final model.
        s: the final model.
        report: progress.
    """
    if s.far or after.far:
        return Allowed(after)
    report("asking how far what is left may have bent the parameters", 0.97)
    s = widened(result, s)
    smooth = curves(s.composition.candidates)
    bent = _bent(s, smooth)
    found = tuple(Discrepancy(e.enters, e.axis, bent.sizes[e], e.unit) for e in smooth if e in bent.sizes)
    return Allowed(grown(after, bent.covariance, _words(found)), found) if found else Allowed(after)


def grown(after: FitResult, covariance: np.ndarray, words: str) -> FitResult:
    """The fit with a covariance, shape (P, P), added to all but what holds if the model is exact, and a remark."""
    exact = after.taken_as_exact().covariance
    budget = None if after.budget is None else replace(after.budget, statistical=after.budget.statistical + covariance)
    warnings = (*after.warnings, words)
    wide = after.covariance + covariance
    return replace(after, covariance=wide, exact_covariance=exact, budget=budget, warnings=warnings)


def _words(found: Sequence[Discrepancy]) -> str:
    each = listed(f"{d.enters} over {d.depends_on} ({d.size:.2g} {d.unit})" for d in found)
    return f"Intervals allow for what is left, and what it may hide in the parameters: {each}."


def _bent(s: CandidateModel, smooth: Sequence[type[AbstractSmooth]]) -> Bend:
    lean = s.lean()
    r, jacobian = fitted_samples(lean.problem, lean.x, lean.weighted)
    priors = believed(lean.problem.layout, lean.x, lean.weighted.prior_sd)
    scales, effects = [variants(e)[0] for e in smooth], {e.name: e for e in smooth}
    each = tangents_inside(lean, scales, lambda v, c: Curve(effects[v.effect.name], np.where(np.isfinite(c), c, 0.0)))
    seen = np.asarray(lean.weighted.slots.weight) > 0.0
    events = np.zeros(seen.shape, dtype=int)
    for number, (lane, stretch) in enumerate(lean.problem.batch.stretches(s.settings.curve_stretches)):
        events[stretch, lane] = number
    return bend(r, jacobian, priors, each, events[seen], s.settings)
