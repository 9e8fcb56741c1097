"""What an effect of the rig in one trace alone would do to the residual: the tangent of a parameter, cut to that trace.

    d r / d a = d r / d p in the samples of the trace, 0 elsewhere,    p = `like` of the effect's family

A winding that was warm in one trace is an R_a of that trace. So one tangent, which the fit has anyway, serves hundreds
of traces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .composition import Effect
from .screen import Background, Signature, Variant
from .settings import DiagnosisSettings

RigEffect = type[AbstractRigEffect]


def screen_of_single_traces(
    background: Background,
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    candidates: Sequence[Effect],
    settings: DiagnosisSettings,
) -> list[Signature]:
    """The signature of those candidates that stand out the most; none of one whose parameter is not free.

    Args:
        background: of the model and residual without them.
        problem, x, weighted: that model.
        candidates: effects of the rig in single traces that do not delay.
        settings: `single_traces`.
    """
    layout = problem.layout
    free = [e for e in candidates if issubclass(e, AbstractRigEffect) and e.like in layout.free]
    if not free:
        return []
    slope, rows = layout.numbers(x)[1], rows_by_file(problem, weighted)

    def column(effect: RigEffect) -> np.ndarray:
        """d residual / d amplitude over its scale, of the trace's own samples."""
        k = layout.free.index(effect.like)
        (p,) = parameters_of(effect)
        return background.jacobian[rows[effect.place.file], k] * p.domain.scale / slope[k]

    found = []
    for effect in _standing_out(free, background, rows, column)[: settings.single_traces]:
        (p,) = parameters_of(effect)
        whole = np.zeros((background.r.size, 1))
        whole[rows[effect.place.file], 0] = column(effect)
        found.append(background.signature(Variant(effect, {}, (p.symbol,)), whole, {p.symbol: p}))
    return found


def _standing_out(
    alone: Sequence[RigEffect],
    background: Background,
    rows: Mapping[str, np.ndarray],
    column: Callable[[RigEffect], np.ndarray],
) -> list[RigEffect]:
    """Effects of single traces by how much they would lower chi2 from the samples of the trace alone, the most first.

    Args:
        alone: the effects.
        background: of the model without them.
        rows: of the fitted samples, by file.
        column: what an effect does to its own samples, shape (n,).
    """
    gains = {e: float(background.among(rows[e.place.file], column(e)[:, None]).gain[0]) for e in alone}
    return sorted(alone, key=lambda effect: -gains[effect])


def rows_by_file(problem: EstimationProblem, weighted: WeightedData) -> dict[str, np.ndarray]:
    """Which of the fitted samples, in the order of the residual's, belong to each trace, by file."""
    weight = np.asarray(weighted.slots.weight)
    number = np.full(weight.shape, -1)
    for k, (lane, _, marks) in enumerate(problem.batch.places):
        number[marks, lane] = k
    fitted = number[weight > 0.0]
    return {trace.measurement.file: np.flatnonzero(fitted == k) for k, trace in enumerate(problem.batch.traces)}
