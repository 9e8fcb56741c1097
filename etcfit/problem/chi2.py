"""chi2 of many points at once: the residual of many parameter vectors, simulated, whitened and squared in one pass.

The residual of one point is a few arrays along the whole batch; those of an ensemble would go through memory many
times. Here each step of the batch is simulated, observed and whitened for all points before the next, points innermost,
so that they share the batch's entries and the processor's vectors are full. The formulas are those of `residual`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..model.effects import State
from ..model.stepper import begun, step
from ..model.throttle import Throttle
from .free_parameters import Form
from .innovations import innovate
from .problem import EstimationProblem
from .residual import WeightedData, equipped, predict, prior_residual, residual

_MOST = 128  # points in one pass; more fall out of the processor's caches
_AT_ONCE = 16  # the same where whole paths must be kept


def chi2_of(
    problem: EstimationProblem, points: Float[np.ndarray, "K P"], weighted: WeightedData
) -> Float[np.ndarray, " K"]:
    """Sum of squared residuals and prior terms at each of K points, shape (K, P) -> (K,); inf where none can be had."""
    passes = -(-len(points) // _MOST)
    size = -(-len(points) // passes)
    full = problem.layout.padded(np.pad(points, ((0, passes * size - len(points)), (0, 0)), mode="edge"))
    form, circuits = problem.layout.form, problem.batch.circuits
    parts = [_chi2_of(form, circuits, part, weighted) for part in np.split(full, passes)]
    chi2 = np.concatenate(parts)[: len(points)]
    return np.where(np.isfinite(chi2), chi2, np.inf)


@partial(jax.jit, static_argnums=(0, 1))
def _chi2_of(
    form: Form, circuits: tuple[str, ...], points: Float[Array, "K P"], weighted: WeightedData
) -> Float[Array, " K"]:
    """Shape (K, P) -> (K,)."""
    if any(effect.delays for effect in form.types):  # a late signal needs the path before it
        return jax.lax.map(lambda x: _of_paths(form, circuits, x, weighted), points, batch_size=_AT_ONCE)
    prior = jax.vmap(lambda x: prior_residual(x, weighted))(points)
    return _in_one_pass(form, circuits, points, weighted) + jnp.sum(prior**2, axis=1)


def _of_paths(form: Form, circuits: tuple[str, ...], x: Float[Array, " P"], weighted: WeightedData) -> Float[Array, ""]:
    return jnp.sum(residual(form, circuits, x, weighted) ** 2) + jnp.sum(prior_residual(x, weighted) ** 2)


def _in_one_pass(
    form: Form, circuits: tuple[str, ...], points: Float[Array, "K P"], weighted: WeightedData
) -> Float[Array, " K"]:
    """Sum of squared residuals, shape (K, P) -> (K,)."""
    values = jax.vmap(lambda x: form.values(x, weighted.pick))(points)

    def one(values: Any, carry: Any, entry: Any) -> Any:
        """One point, one lane, one entry of the batch."""
        s, reset, slots, circuit_of, filter_ = entry
        x, z, error, chi2 = carry
        throttle = Throttle.build(form.types, values)
        s = equipped(s, circuit_of, circuits, values)
        x, z = step(throttle, *begun(throttle, x, z, reset), s)
        missed = slots.weight * (slots.value - predict(throttle, (x, z), s, reset, slots))
        error, r = innovate(error, filter_, missed)
        return x, z, error, chi2 + jnp.sum(r**2)

    each = jax.vmap(jax.vmap(one, in_axes=(0, 0, None)), in_axes=(None, 0, 0))
    p = weighted
    batch = p.steps, p.resets, p.slots, p.circuit_of, p.whitening
    start = _start(form, values, (p.steps.dt.shape[1], points.shape[0]), p.whitening.transition.shape[-1])
    return jnp.sum(jax.lax.scan(lambda carry, entry: (each(values, carry, entry), None), start, batch)[0][-1], axis=0)


def _start(form: Form, values: Any, shape: tuple[int, int], order: int) -> Any:
    """State, memories, error states and chi2 of every lane and point, shape (L, K) each."""
    zero = jnp.zeros(shape)
    memories = Throttle.build(form.types, values).z0
    return State(zero, zero, zero), tuple(jnp.full(shape, z) for z in memories), (zero,) * order, zero
