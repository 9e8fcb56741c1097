"""Tangents of effects that act as inputs: what each adds along the path of the model as it is, differentiated once.

A model that had the effects in it would have to be compiled for them; this one is that of the fit, whatever is asked.

Source: forcing of the sensitivity equations, Khalil 2002, Nonlinear Systems, 3.3. Differs from source: exact for the
scheme and its contacts, not for the ODE.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..kernels.machine import available
from ..model.input_perturbation import acts_as_input, only_delays
from ..model.parameters import declared
from ..problem.cores import side_by_side
from ..problem.input_perturbation import added_by, added_late, responses, where_asked
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .composition import Effect, resting
from .screen import AT_ONCE, Variant, off_its_bound, some_at_once

Made = TypeVar("Made")


class _Direction(NamedTuple):
    """Of one amplitude: the effect's parameters where it is differentiated, and the way, SI by field."""

    effect: Effect
    values: dict[str, Any]
    ways: dict[str, Any]


def tangents_along_path(
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    every: Sequence[Variant],
    use: Callable[[Variant, np.ndarray], Made],
) -> list[Made]:
    """For each variant what `use` makes of the derivative of the fitted samples' residual in each amplitude over its
    scale, (n, k).

    Args:
        problem, x, weighted: a model at its optimum.
        every: variants of effects that it has not, and that it `serves`.
        use: called by several threads.
    """
    form, padded = problem.layout.form, problem.layout.padded(x)
    seen = np.asarray(weighted.slots.weight) > 0.0
    where = where_asked(form, padded, weighted)

    def columns(few: Sequence[_Direction]) -> list[np.ndarray]:
        besides = tuple((added_late if only_delays(way.effect) else added_by)(*way, where) for way in few)
        besides += (besides[-1],) * (0 if available() else AT_ONCE - len(few))  # one shape is compiled once
        found = np.asarray(responses(form, padded, weighted, besides))
        return [each[seen] for each in found[: len(few)]]

    def some(variants: Sequence[Variant]) -> list[Made]:
        ways = [way for variant in variants for way in _directions(variant)]
        found = (each for k in range(0, len(ways), AT_ONCE) for each in columns(ways[k : k + AT_ONCE]))
        return [use(variant, np.stack([next(found) for _ in variant.amplitudes], axis=1)) for variant in variants]

    return [each for few in side_by_side(some, some_at_once(every, AT_ONCE)) for each in few]


def serves(problem: EstimationProblem, effect: Effect) -> bool:
    """Whether an effect is screened along the path of a model: where it acts as an input or only delays, no ECU in the
    model reads what it does to a sensor, and nothing is late there yet."""
    types = problem.layout.types
    known = acts_as_input(effect) or (only_delays(effect) and not any(e.delays for e in types))
    return known and not any(e.commands for e in types)


def _directions(variant: Variant) -> Iterator[_Direction]:
    """One for each amplitude."""
    parameters = declared(variant.effect)
    field_of = {p.symbol: field for field, p in parameters.items()}
    rest = {s: float(v) for s, v in {**resting(variant.effect), **variant.shape}.items()}
    for symbol in variant.amplitudes:
        domain = parameters[field_of[symbol]].domain
        values, ways = dict(rest), dict.fromkeys(rest, 0.0)
        values[symbol] += off_its_bound(domain) * domain.scale
        ways[symbol] = domain.scale
        yield _Direction(variant.effect, *({field_of[s]: v for s, v in each.items()} for each in (values, ways)))
