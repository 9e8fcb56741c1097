"""Tangents of the residual in the amplitudes of effects that act in the throttle, each computed in the cheapest way."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from ..kernels.machine import available
from ..model.input_perturbation import acts_as_input, only_delays
from ..model.parameters import AbstractDomain, NonNegative, declared
from ..problem import residual_kernels
from ..problem.cores import side_by_side
from ..problem.free_parameters import Form
from ..problem.input_perturbation import added_by, added_late, evaluation_points, responses
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, residual
from .candidate_model import CandidateModel
from .composition import Effect, resting

# numerical constants: a step and bounds on memory
_PROBE = 1e-3  # amplitude over its scale at which a tangent is taken: at a bound of 0 the tangent may not exist
AT_ONCE = 8  # tangents computed together
_TOGETHER = 128  # most effects times tangents of one model


@dataclass(frozen=True, eq=False)
class Variant:
    """One candidate with one choice of its shape."""

    effect: Effect  # the candidate
    shape: Mapping[str, float]  # shape parameters, and amplitudes that are scanned, SI by symbol
    amplitudes: tuple[str, ...]  # symbols of the amplitudes


def variants(effect: Effect) -> tuple[Variant, ...]:
    """A candidate at every combination of its `scan` values; its other shape parameters are nominal."""
    rest, off = resting(effect), effect.off or {}
    shape = {s: v for s, v in rest.items() if s not in off}
    grid = itertools.product(*effect.scan.values())
    return tuple(Variant(effect, shape | dict(zip(effect.scan, point, strict=True)), tuple(off)) for point in grid)


def in_groups(effects: Sequence[Effect]) -> list[tuple[Effect, ...]]:
    """Groups of effects that are screened in one model: few enough for the cost of their tangents, and alike in whether
    they delay signals and whether they need tangents.

    The cost of a tangent grows with the number of effects in the model, so an effect with many variants is alone or
    nearly alone in its group; but each model is a program to compile. A model with a delay has to keep the path.
    """
    groups: list[tuple[Effect, ...]] = []
    for effect in sorted(effects, key=lambda e: (*_kind(e), -_tangents_of(e))):
        last = groups[-1] if groups else ()
        together = (*last, effect)
        cost = len(together) * sum(map(_tangents_of, together))
        if last and _kind(last[0]) == _kind(effect) and cost <= _TOGETHER:
            groups[-1] = together
        else:
            groups.append((effect,))
    return groups


def _tangents_of(effect: Effect) -> int:
    """Number of tangents that the screening of an effect takes."""
    return sum(len(variant.amplitudes) for variant in variants(effect))


def _kind(effect: Effect) -> tuple[bool, bool]:
    """Whether an effect delays signals, and whether all its amplitudes are scanned."""
    return effect.delays, set(effect.off or {}) <= set(effect.scan)


@partial(jax.jit, static_argnums=0)
def _residuals(form: Form, x: Any, weighted: WeightedData, fulls: Any) -> Any:
    """Residual at K sets of values, (K, Q) -> (K, T, L, M)."""
    return jax.vmap(lambda full: residual(form, x, weighted._replace(pick=weighted.pick._replace(full=full))))(fulls)


@partial(jax.jit, static_argnums=0)
def _tangents(form: Form, x: Any, weighted: WeightedData, fulls: Any, ways: Any) -> Any:
    """Residual at K sets of values, and its derivative along K directions, (K, Q) each -> (K, T, L, M) each."""

    def one(full: Any, way: Any) -> Any:
        def shifted(e: Any) -> Any:
            pick = weighted.pick._replace(full=full + e * way)
            return residual(form, x, weighted._replace(pick=pick))

        return jax.jvp(shifted, (0.0,), (1.0,))

    return jax.vmap(one)(fulls, ways)


def tangents(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, every: Sequence[Variant]
) -> list[np.ndarray]:
    """For each variant the derivative of the fitted samples' residual in each amplitude over its scale, (n, k)."""
    layout = problem.layout
    fulls, ways = _directions(problem, np.array(weighted.pick.full, dtype=float), every)
    seen, padded = np.asarray(weighted.slots.weight) > 0.0, layout.padded(x)

    def one(full: np.ndarray, way: np.ndarray) -> np.ndarray:
        """The derivative along a direction; the residual itself where the direction is 0."""
        at = layout.form.full(padded, weighted.pick._replace(full=full))
        if not way.any():
            return np.asarray(residual_kernels.compared(layout.form, at, weighted).r)[seen]
        (k,) = np.flatnonzero(way)
        by = (layout.parameters[k].symbol,)
        return residual_kernels.linearised(layout.form, at, weighted, by)[1][seen, 0] * way[k]

    def some(k: int) -> list[np.ndarray]:
        few = slice(k, k + AT_ONCE)
        if available():
            return list(map(one, fulls[few], ways[few]))
        if not ways.any():
            return [r[seen] for r in np.asarray(_residuals(layout.form, padded, weighted, fulls[few]))]
        both = map(np.asarray, _tangents(layout.form, padded, weighted, fulls[few], ways[few]))
        return [(t if way.any() else r)[seen] for r, t, way in zip(*both, ways[few], strict=True)]

    base, *each = (one for few in side_by_side(some, range(0, len(fulls), AT_ONCE)) for one in few)
    found = iter(each)

    def column(variant: Variant, symbol: str) -> np.ndarray:
        if symbol not in variant.shape:
            return next(found)
        return (next(found) - base) * layout.parameter(symbol).domain.scale / variant.shape[symbol]

    return [np.stack([column(v, symbol) for symbol in v.amplitudes], axis=1) for v in every]


def off_its_bound(domain: AbstractDomain) -> float:
    """Distance from the off value at which an amplitude is differentiated, over its scale: 0 where either sign is
    allowed."""
    return _PROBE if isinstance(domain, NonNegative) else 0.0


class _Directions(NamedTuple):
    """Sets of all values, and directions in which the residual is differentiated there, 0 for the residual itself;
    shape (K, Q) each."""

    fulls: np.ndarray
    ways: np.ndarray


def _directions(problem: EstimationProblem, rest: np.ndarray, every: Sequence[Variant]) -> _Directions:
    """The model at rest first, then one row for each amplitude of each variant; padded to whole batches.

    Args:
        rest: all its values with every candidate off, shape (Q,).
    """
    layout, index = problem.layout, problem.layout.form.index
    fulls, ways = [rest], [np.zeros(rest.size)]
    for variant in every:
        full = rest.copy()
        for symbol, value in variant.shape.items():
            full[index[symbol]] = value
        for symbol in variant.amplitudes:
            domain, way = layout.parameter(symbol).domain, np.zeros(full.size)
            way[index[symbol]] = domain.scale
            fulls.append(full if symbol in variant.shape else full + way * off_its_bound(domain))
            ways.append(np.zeros(full.size) if symbol in variant.shape else way)
    padding = -len(fulls) % AT_ONCE
    return _Directions(np.stack(fulls + [fulls[-1]] * padding), np.stack(ways + [ways[-1]] * padding))


def fitted_samples(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> tuple[np.ndarray, np.ndarray]:
    """Residual of the fitted samples, shape (n,), and its Jacobian, shape (n, P), at coordinates x, shape (P,)."""
    r, _, jacobian = problem.linearise(x, weighted)
    seen = np.asarray(weighted.slots.weight) > 0.0
    return r[seen], jacobian[seen]


def stretch_of_samples(problem: EstimationProblem, weighted: WeightedData, count: int) -> np.ndarray:
    """Number of the stretch of each fitted sample, every trace being cut into so many equal ones, shape (n,)."""
    number = np.zeros(np.shape(weighted.slots.weight), dtype=int)
    for k, (lane, stretch) in enumerate(problem.batch.stretches(count)):
        number[stretch, lane] = k
    return number[np.asarray(weighted.slots.weight) > 0.0]


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives of the residual of the fitted samples in the free parameters of a model.

    They are computed in groups, because all of them together would be the largest array of a diagnosis, and their
    kernel would take the longest to compile.
    """

    # problem, x, weighted: the model, at coordinates x, shape (P,)
    problem: EstimationProblem
    x: np.ndarray
    weighted: WeightedData
    wanted: frozenset[str]  # symbols whose derivatives are kept for later calls after they were computed
    kept: dict[str, np.ndarray]  # these derivatives in the value (SI), shape (n,) each

    @classmethod
    def of_model(
        cls, problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, wanted: Iterable[str] = ()
    ) -> Tangents:
        """The tangents of a model; none is computed yet."""
        return cls(problem, x, weighted, frozenset(wanted), {})

    def together(self, symbols: tuple[str, ...]) -> dict[str, np.ndarray]:
        """The derivative by each of these free parameters, SI, shape (n,)."""
        found = dict(zip(symbols, slopes_of(self.problem, self.x, self.weighted, symbols), strict=True))
        self.kept.update({s: np.array(column) for s, column in found.items() if s in self.wanted})
        return found

    def along(self, symbol: str, scale: float) -> np.ndarray | None:
        """The derivative by a parameter over a scale, SI, shape (n,); None where the parameter is not free."""
        if symbol not in self.problem.layout.free:
            return None
        return (self.kept[symbol] if symbol in self.kept else self.together((symbol,))[symbol]) * scale


def slopes_of(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, symbols: tuple[str, ...]
) -> list[np.ndarray]:
    """Derivative of the fitted samples' residual in the value of each free parameter that is named, shape (n,) each."""
    layout, seen = problem.layout, np.asarray(weighted.slots.weight) > 0.0
    if available():
        full = layout.form.full(layout.padded(x), weighted.pick)
        columns = residual_kernels.linearised(layout.form, full, weighted, symbols)[1][seen]
        return [*columns.T]
    jacobian, slope = problem.linearise(x, weighted)[2][seen], layout.numbers(x)[1]
    return [jacobian[:, k] / slope[k] for k in map(layout.free.index, symbols)]


def some_at_once(every: Sequence[Variant], amplitudes: int) -> list[list[Variant]]:
    """Variants in order, in groups of at least this number of amplitudes."""
    out: list[list[Variant]] = []
    count = amplitudes
    for variant in every:
        if count >= amplitudes:
            out, count = [*out, []], 0
        out[-1].append(variant)
        count += len(variant.amplitudes)
    return out


# ---- Tangents of effects that act as inputs: the contribution of each along the path of the present model,
# differentiated.
#
# A model that contained the effects would have to be compiled; the present model is already compiled for the fit.
#
# Source: forcing of the sensitivity equations, Khalil 2002, Nonlinear Systems, 3.3. Differs from source: exact for the
# scheme and its contacts, not for the ODE.

Made = TypeVar("Made")


class _Direction(NamedTuple):
    """The direction of one amplitude: the effect's parameters where it is differentiated, and the change, SI by
    field."""

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
    """For each variant the result of `use` on the derivative of the fitted samples' residual in each amplitude over its
    scale, (n, k), along the path of the model.

    Args:
        use: called by several threads.
    """
    form, padded = problem.layout.form, problem.layout.padded(x)
    seen = np.asarray(weighted.slots.weight) > 0.0
    where = evaluation_points(form, padded, weighted)

    def columns(few: Sequence[_Direction]) -> list[np.ndarray]:
        besides = tuple((added_late if only_delays(way.effect) else added_by)(*way, where) for way in few)
        besides += (besides[-1],) * (0 if available() else AT_ONCE - len(few))  # one shape is compiled once
        found = np.asarray(responses(form, padded, weighted, besides))
        return [each[seen] for each in found[: len(few)]]

    def some(variants: Sequence[Variant]) -> list[Made]:
        ways = [way for variant in variants for way in _amplitude_directions(variant)]
        found = (each for k in range(0, len(ways), AT_ONCE) for each in columns(ways[k : k + AT_ONCE]))
        return [use(variant, np.stack([next(found) for _ in variant.amplitudes], axis=1)) for variant in variants]

    return [each for few in side_by_side(some, some_at_once(every, AT_ONCE)) for each in few]


def serves(problem: EstimationProblem, effect: Effect) -> bool:
    """Whether an effect can be screened along the path of a model: it acts as an input or only delays, no ECU in the
    model reads a sensor that it changes, and the model has no delay yet."""
    types = problem.layout.types
    known = acts_as_input(effect) or (only_delays(effect) and not any(e.delays for e in types))
    return known and not any(e.commands for e in types)


def _amplitude_directions(variant: Variant) -> Iterator[_Direction]:
    """The direction of each amplitude."""
    parameters = declared(variant.effect)
    field_of = {p.symbol: field for field, p in parameters.items()}
    rest = {s: float(v) for s, v in {**resting(variant.effect), **variant.shape}.items()}
    for symbol in variant.amplitudes:
        domain = parameters[field_of[symbol]].domain
        values, ways = dict(rest), dict.fromkeys(rest, 0.0)
        values[symbol] += off_its_bound(domain) * domain.scale
        ways[symbol] = domain.scale
        yield _Direction(variant.effect, *({field_of[s]: v for s, v in each.items()} for each in (values, ways)))


def tangents_inside(
    s: CandidateModel, every: Sequence[Variant], use: Callable[[Variant, np.ndarray], Made]
) -> list[Made]:
    """For each variant the result of `use` on the derivative of the fitted samples' residual in each amplitude over its
    scale, (n, k); the derivatives of all variants together would take much memory.

    An effect that acts as an input is screened along the path of the model; for the others some models are made, each
    with a few of them.

    Args:
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
    """The same from models with groups of effects; some run in parallel, because each compiles a model."""

    def screened_together(group: tuple[Effect, ...]) -> dict[Variant, Made]:
        own = [v for v in every if v.effect in group]
        if not own:
            return {}
        whole = s.composed(group)
        columns = tangents(whole.problem, whole.x, whole.weighted, own)
        return dict(zip(own, map(use, own, columns), strict=True))

    # all candidates, including those at work: so the groups are the same in every round, and their programs are reused
    groups = in_groups([e for e in s.composition.inside if not serves(s.problem, e)])
    with ThreadPoolExecutor(s.settings.refits_side_by_side) as pool:
        return {v: made for found in pool.map(screened_together, groups) for v, made in found.items()}
