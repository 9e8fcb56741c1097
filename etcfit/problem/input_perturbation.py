"""First-order changes of a model's residual by effects that are not in the model; compiled.

The formulas are in `etcfit.model.input_perturbation`.

The model is simulated once; the contribution of each effect to each step is evaluated, without a simulation; and the
residual is differentiated along it. The program of an effect works for every model.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..kernels.machine import available
from ..model.effects import AbstractEffect, Besides, State
from ..model.input_perturbation import StepInputs, added, added_at, step_inputs, step_inputs_along
from ..model.parameters import AnyArray, Scalar
from ..model.stepper import GAMMA, Reset, Step, StepBesides, begun, step
from ..model.throttle import Throttle
from . import late_kernels, one_pass_kernels
from .free_parameters import Form
from .lanes import Along
from .lateness import Simulated, acting_late
from .one_pass import advance, carried_like, has_single_pass, pushed
from .records import Entries, numbered, used_rows
from .residual import WeightedData, equipped, residual, run


class Where(NamedTuple):
    """Points at which the steps of a batch evaluate the effects, and the simulated batch; entries of shape (T, L)."""

    inputs: StepInputs
    steps: Step
    resets: Reset


@partial(jax.jit, static_argnums=0)
def _evaluation_points(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Where:
    """Points at which the steps of a model evaluate the effects; arguments as of `residual`."""
    throttle, path, steps, resets = run(form, x, weighted.pick, weighted)
    return Where(step_inputs_along(throttle, path, steps, resets), steps, resets)


@partial(jax.jit, static_argnums=0)
def _added_by(
    effect: type[AbstractEffect], values: Mapping[str, Scalar], ways: Mapping[str, Scalar], where: Where
) -> StepBesides:
    """The contribution of an effect to each step along a direction of its parameters, see
    `model.input_perturbation.added`."""
    return added(effect, values, ways, *where)


@partial(jax.jit, static_argnums=0)
def _responses(
    form: Form, x: Float[Array, " P"], weighted: WeightedData, besides: tuple[StepBesides, ...]
) -> Float[Array, "K T L M"]:
    ways: Any = jax.tree.map(lambda *leaves: jnp.stack(leaves), *besides)
    nothing = jax.tree.map(jnp.zeros_like, besides[0])

    def residual_with(acts: StepBesides) -> Float[Array, "T L M"]:
        return residual(form, x, weighted._replace(steps=weighted.steps._replace(besides=acts)))

    return jax.vmap(lambda way: jax.jvp(residual_with, (nothing,), (way,))[1])(ways)


def evaluation_points(form: Form, x: Float[np.ndarray, " P"], weighted: WeightedData) -> Where:
    """Points at which the steps of a model evaluate the effects; arguments as of `residual`."""
    if not available():
        return _evaluation_points(form, x, weighted)
    full = form.full(x, weighted.pick)
    tree = Simulated(weighted.steps, weighted.resets, weighted.test_of)
    tree = tree._replace(steps=acting_late(form, full, tree))
    changing = numbered(tree)[0]
    renewed = frozenset({changing.guide_stiffness, *jax.tree.leaves(changing.acting)})
    return _POINTS.run((form,), full, Entries(tree, one_pass_kernels.rows_of(weighted), renewed))


def added_by(
    effect: type[AbstractEffect], values: Mapping[str, float], ways: Mapping[str, float], where: Where
) -> StepBesides:
    """The contribution of an effect to each step along a direction of its parameters, see
    `model.input_perturbation.added`."""
    if not available():
        return _added_by(effect, values, ways, where)
    batch = Entries(where, used_rows(where.steps, where.resets))
    return _ADDED.run((effect, tuple(values)), np.array([*values.values(), *ways.values()]), batch)


def added_late(
    effect: type[AbstractEffect], values: Mapping[str, float], ways: Mapping[str, float], where: Where
) -> StepBesides:
    """The contribution to each step of an effect that only delays (`only_delays`), along a direction of its parameters
    from no delay:

        dv/dt_a = input a moment before minus present input;    dy/dt_c = -dy/dt

    Each step has the mean of its input, jumps included (`model.delay.late_inputs`); a channel is a straight line
    between entries (`model.delay.delayed`).
    """

    def delays(values: Mapping[str, Scalar]) -> tuple[Scalar, ...]:
        c = effect(**values)(State(0.0, 0.0, 0.0), (), where.inputs.read)
        return tuple(jnp.asarray(each, float) for each in (c.input_delay, c.position_delay, c.current_delay))

    late, position, current = (float(d) for d in jax.jvp(delays, (dict(values),), (dict(ways),))[1])
    s, begins = where.steps, np.asarray(where.resets.begins) > 0.5
    dt = np.asarray(s.dt)
    moves, first = (dt > 0.0) & ~begins, np.concatenate((begins[:1], begins[:-1]))  # the step after a trace's begin

    def before(column: np.ndarray) -> np.ndarray:
        return np.concatenate((column[:1], column[:-1]))

    def over(change: np.ndarray, span: np.ndarray) -> np.ndarray:
        return np.where(moves & (span > 0.0), change / np.where(span > 0.0, span, 1.0), 0.0)

    def acting(begin: Any, end: Any) -> tuple[np.ndarray, np.ndarray]:
        """Values at begin and end of each step; before a trace begins its first level acts."""
        begin, end = np.asarray(begin), np.asarray(end)
        mean = over(np.where(first, begin, before(end)) - end, dt)
        start = np.where(first, 0.0, over(before(begin) - before(end), before(dt)))
        swing = 0.5 * (over(begin - end, dt) - start)
        return late * (mean - swing), late * (mean + swing)

    def shown(column: Any) -> np.ndarray:
        return -over(np.asarray(column) - before(np.asarray(column)), dt)

    volts, torque, nothing = acting(s.voltage0, s.voltage1), acting(s.torque0, s.torque1), np.zeros(dt.shape)
    early, end = (
        Besides(t, v, nothing, nothing, nothing, t, nothing)
        for v, t in ((each[0][0] + f * (each[0][1] - each[0][0]), each[1][0] + f * (each[1][1] - each[1][0]))
                     for f, each in ((GAMMA, (volts, torque)), (1.0, (volts, torque))))
    )  # fmt: skip
    end = end._replace(position=position * shown(where.inputs.position), current=current * shown(where.inputs.current))
    return StepBesides(early, end)


def responses(
    form: Form, x: Float[np.ndarray, " P"], weighted: WeightedData, besides: tuple[StepBesides, ...]
) -> Float[AnyArray, "K T L M"]:
    """First-order changes of the residual by contributions in addition to all effects.

    Args:
        form, x, weighted: as of `residual`.
        besides: K contributions, entries of shape (T, L).
    Returns:
        Shape (K, T, L, M), dimensionless.
    """
    if not available():
        return _responses(form, x, weighted, besides)
    full, order = form.full(x, weighted.pick), weighted.whitening.transition.shape[-1]
    if not has_single_pass(form, weighted):
        return late_kernels.responses(form, full, weighted, besides)
    data = one_pass_kernels.data_of(weighted)

    def along(way: StepBesides) -> np.ndarray:
        tree = data, way
        numbers, acts = numbered(tree)
        renewed, muted = one_pass_kernels.renewed_and_muted(numbers)
        rows, ways = one_pass_kernels.rows_of(weighted), frozenset(jax.tree.leaves(acts))
        batch = Entries(tree, rows, renewed | ways, muted)
        return np.asarray(_RESPONSES.run((form, order), full, batch))

    return np.stack(list(map(along, besides)))


def _asks(form: Form) -> Any:
    def one(values: Any, path: Any, entry: Any) -> Any:
        s, reset, test_of = entry
        throttle = Throttle.build(form.types, values)
        s, reset = equipped(throttle, s, reset, test_of, values)
        x, z = begun(throttle, path[0], path[1], s, reset)
        return step(throttle, x, z, s), Where(step_inputs(throttle, x, z, s), s, reset)

    memories = Throttle.build(form.types, dict.fromkeys(form.index, 0.5)).z0
    return one, tuple(form.index), (State(0.0, 0.0, 0.0), memories), form.ties


def _adds(effect: type[AbstractEffect], fields: tuple[str, ...]) -> Any:
    ways = [f"way of {field}" for field in fields]

    def one(values: Any, carried: Any, entry: Where) -> Any:
        at, along = {f: values[f] for f in fields}, {f: values[way] for f, way in zip(fields, ways, strict=True)}
        return added_at(effect, at, along, carried, (entry.inputs, entry.steps, entry.resets))

    return one, (*fields, *ways), (effect.z0,) * 2, ()


def _responds(form: Form, order: int) -> Any:
    def one(values: Any, carried: Any, entry: Any) -> Any:
        (s, *data), way = entry

        def response(before: Any, acts: StepBesides) -> Any:
            after, (_, r) = advance(form, values, before, (s._replace(besides=acts), *data))
            return after, r

        return pushed(response, carried, way)

    return one, tuple(form.index), (carried_like(form, order),) * 2, form.ties


_POINTS, _ADDED, _RESPONSES = Along(_asks, _asks), Along(_adds, _adds), Along(_responds, _responds)
