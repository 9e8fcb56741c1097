"""What an effect of the rig in one trace alone would do to the residual: the tangent of a parameter, cut to that trace.

    d r / d a = d r / d p in the samples of the trace, 0 elsewhere

A winding that was warm in one trace is an R_a of that trace (`like` of the effect's family). A channel that reads too
much in one trace is that of its whole test, where the model has that one; elsewhere what the reading alone does is
whitened: - W (d y_logged / d a). So a tangent, which is there anyway, or one whitening serves hundreds of traces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.machine import available
from ..model.parameters import declared, parameters_of
from ..model.rig_effects import FAMILY_BY_KIND, OBSERVED, AbstractRigEffect, number_of
from ..problem import late_kernels
from ..problem.batch import KINDS
from ..problem.innovations import whiten
from ..problem.one_pass_kernels import rows_of
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .composition import Effect, is_of_one_channel
from .screen import Background, Signature, Tangents, Variant
from .settings import DiagnosisSettings

RigEffect = type[AbstractRigEffect]


def screen_of_single_traces(
    background: Background,
    tangents: Tangents,
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    candidates: Sequence[Effect],
    settings: DiagnosisSettings,
) -> list[Signature]:
    """The signature of those candidates that stand out the most, of whole traces and of single channels; none of one
    of which nothing here tells what it does.

    Args:
        background: of the model and residual without them.
        tangents: of that model with effects of the rig in whole tests beside it.
        problem, x, weighted: that model.
        candidates: effects of the rig in single traces that do not delay.
        settings: `single_traces`.
    """
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect)]
    if not rigs:
        return []
    rows, columns = rows_by_file(problem, weighted), _Columns(background, tangents, problem, x, weighted)
    told = {e: column for e in rigs if (column := columns.of(e)) is not None}
    kinds = [{e: c for e, c in told.items() if is_of_one_channel(e) is single} for single in (False, True)]
    few, found = settings.single_traces, []
    for effect in (e for kind in kinds for e in _standing_out(kind, background, rows)[:few]):
        (p,) = parameters_of(effect)
        own, whole = rows[effect.place.file], np.zeros((background.r.size, 1))
        whole[own, 0] = told[effect][own]
        found.append(background.signature(Variant(effect, {}, (p.symbol,)), whole, {p.symbol: p}))
    return found


def of_whole_tests(candidates: Sequence[Effect]) -> set[str]:
    """Parameters of effects of whole tests whose tangents say what candidates of single traces would do."""
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect) and not e.like]
    return {p.symbol for e in rigs for p in parameters_of(_in_whole_test(e))}


def _in_whole_test(effect: RigEffect) -> RigEffect:
    return FAMILY_BY_KIND[effect.kind].at(effect.place._replace(file=""))


class _Columns:
    """What effects of single traces would do, were they at work in every trace of their test.

    Args:
        background, tangents, problem, x, weighted: as of `screen_of_single_traces`.
    """

    def __init__(
        self,
        background: Background,
        tangents: Tangents,
        problem: EstimationProblem,
        x: np.ndarray,
        weighted: WeightedData,
    ) -> None:
        self._background, self._tangents = background, tangents
        self._problem, self._x, self._weighted = problem, x, weighted
        self._kept: dict[RigEffect, np.ndarray | None] = {}

    def of(self, effect: RigEffect) -> np.ndarray | None:
        """d residual / d amplitude over its scale, shape (n,); None where nothing tells it."""
        whole = _in_whole_test(effect)
        if whole not in self._kept:
            self._kept[whole] = self._of_test(whole)
        return self._kept[whole]

    def _of_test(self, whole: RigEffect) -> np.ndarray | None:
        (p,) = parameters_of(whole)
        if whole.like:
            return self._of_parameter(whole.like, p.domain.scale)
        found = self._tangents.along(p.symbol, p.domain.scale)
        return self._of_reading(whole) if found is None and whole.place.channel in OBSERVED else found

    def _of_parameter(self, symbol: str, scale: float) -> np.ndarray | None:
        """By a parameter of the throttle, which the background has anyway."""
        layout = self._problem.layout
        if symbol not in layout.free:
            return None
        k = layout.free.index(symbol)
        return self._background.jacobian[:, k] * scale / layout.numbers(self._x)[1][k]

    def _of_reading(self, whole: RigEffect) -> np.ndarray:
        """- W (y_logged - y_hat) at an amplitude of its scale, in every trace."""
        ((field, p),) = declared(whole).items()
        channel, weight = whole.place.channel, np.asarray(self._weighted.slots.weight)
        seen = self._seen
        read = whole(**{field: p.domain.scale}).read({channel: seen}, number_of(whole.place.test), None)[channel]
        here = (np.asarray(self._weighted.slots.kind) == KINDS.index(channel)) & (weight > 0.0)
        return whitened(self._weighted, np.where(here, seen - read, 0.0))[weight > 0.0]

    @cached_property
    def _seen(self) -> Float[np.ndarray, "T L M"]:
        return self._problem.simulated(self._x, self._problem.guide_stiffness)


def whitened(weighted: WeightedData, error: Float[np.ndarray, "T L M"]) -> Float[np.ndarray, "T L M"]:
    """An error, SI, by the filter of the data."""
    if available():
        return late_kernels.whitened(weighted.whitening, error[None], rows_of(weighted))[0]
    return np.asarray(_by_jax(weighted.whitening, error))


_by_jax = jax.jit(whiten)


def _standing_out(
    alone: Mapping[RigEffect, np.ndarray], background: Background, rows: Mapping[str, np.ndarray]
) -> list[RigEffect]:
    """Effects of single traces by how much they would lower chi2 from the samples of the trace alone, the most first.

    Args:
        alone: the effects, and what each would do to all samples, shape (n,).
        background: of the model without them.
        rows: of the fitted samples, by file.
    """
    gains: dict[RigEffect, float] = {}
    for effect, column in alone.items():
        own = rows[effect.place.file]
        gains[effect] = float(background.among(own, column[own, None]).gain[0])
    return sorted(alone, key=lambda effect: -gains[effect])


def rows_by_file(problem: EstimationProblem, weighted: WeightedData) -> dict[str, np.ndarray]:
    """Which of the fitted samples, in the order of the residual's, belong to each trace, by file."""
    weight = np.asarray(weighted.slots.weight)
    number = np.full(weight.shape, -1)
    for k, (lane, _, marks) in enumerate(problem.batch.places):
        number[marks, lane] = k
    fitted = number[weight > 0.0]
    return {trace.measurement.file: np.flatnonzero(fitted == k) for k, trace in enumerate(problem.batch.traces)}
