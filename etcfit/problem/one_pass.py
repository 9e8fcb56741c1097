"""A batch in one pass: each entry is simulated, observed and whitened before the next, so that no path is kept.

The carry from entry to entry of a lane is the plate's state, the memories of effects and the error states of the
whitening filter. The formulas are those of `residual`. A late signal needs the path before it: models with such an
effect have no single pass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..model.effects import State
from ..model.parameters import Scalar
from ..model.stepper import StepBesides, begun, step
from ..model.throttle import Throttle
from .free_parameters import Form
from .innovations import innovate
from .residual import Compared, WeightedData, equipped, shown


class Carried(NamedTuple):
    """The carry from one entry of a lane to the next."""

    x: State  # state of the plate
    z: tuple[Scalar, ...]  # memories of the effects
    error: tuple[Scalar, ...]  # the n error states of the whitening filter, SI


def has_single_pass(form: Form, weighted: WeightedData) -> bool:
    """Whether no effect of the model delays a signal and no sample moves: only then the path before an entry is not
    needed."""
    return weighted.whitening.moved is None and not any(effect.delays for effect in form.types)


def entries(weighted: WeightedData) -> tuple[Any, ...]:
    """The data in the form for `advance`, a tuple whose leaves have the axes T and L first."""
    return weighted.steps, weighted.resets, weighted.slots, weighted.test_of, weighted.whitening


def start(form: Form, values: Mapping[str, Scalar], shape: tuple[int, ...], order: int) -> Carried:
    """The carry into the first entry: zeros, and the effects' initial memories.

    Args:
        values: values of its parameters, SI by symbol.
        shape: shape of every entry of the state, such as (L,).
        order: number n of error states.
    """
    zero = jnp.zeros(shape)
    memories = tuple(jnp.full(shape, z) for z in Throttle.build(form.types, dict(values)).z0)
    return Carried(State(zero, zero, zero), memories, (zero,) * order)


def carried_like(form: Form, order: int) -> Carried:
    """Example numbers of the carry of one lane, to trace an entry; arguments as of `start`."""
    return jax.eval_shape(lambda: start(form, dict.fromkeys(form.index, 0.5), (), order))


def pushed(
    step_of: Callable[[Carried, StepBesides], tuple[Carried, Any]], carried: tuple[Carried, Carried], way: StepBesides
) -> tuple[tuple[Carried, Carried], Any]:
    """A step and its tangent along a contribution in addition to all effects.

    Args:
        step_of: function of the carry into the step and the contribution; returns the new carry and results.
        carried: the carry from the step before, and its tangent.
    Returns:
        The new carry and its tangent, and the tangent of the results.
    """
    before, moved = carried
    (after, _), (moved, results) = jax.jvp(step_of, (before, StepBesides.nothing()), (moved, way))
    return (after, moved), results


def advance(
    form: Form, values: Mapping[str, Scalar], carried: Carried, entry: tuple[Any, ...]
) -> tuple[Carried, Compared]:
    """Simulate, observe and whiten one entry of one lane.

    Args:
        values: values of its parameters, SI by symbol.
        carried: the carry from the entry before.
        entry: steps, resets, slots, rig test and filter of this entry, see `entries`.
    Returns:
        The new carry, and the simulated values of its slots with the residual, shape (M,) each.
    """
    s, reset, slots, test_of, filter_ = entry
    throttle = Throttle.build(form.types, values)
    s, reset = equipped(throttle, s, reset, test_of, values)
    x, z = step(throttle, *begun(throttle, carried.x, carried.z, s, reset), s)
    seen = shown(throttle.read(throttle.observe(x, z, s.inputs(1.0)), test_of, s.trace), slots.kind)
    error, r = innovate(carried.error, filter_, slots.weight * (slots.value - seen))
    return Carried(x, z, error), Compared(seen, r)
