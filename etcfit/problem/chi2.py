"""chi2 of many points at once: the residual of many parameter vectors, simulated, whitened and squared in one pass.

The residual of one point is a few arrays along the whole batch; for an ensemble they would be read from memory many
times. Here all points are computed for one entry of the batch at a time, points innermost, so that they share its data
and fill the processor's vectors.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..kernels.machine import available
from . import residual_kernels
from .cores import CORES, side_by_side
from .free_parameters import Form
from .one_pass import advance, entries, has_single_pass, start
from .problem import EstimationProblem
from .residual import WeightedData, prior_residual, prior_residual_here, residual

_MOST = 64  # largest number of points in one pass; more do not fit into the processor's caches
_LEAST = 32  # the same if there are enough points for every core: fewer take longer per point
_FEW = 8  # number of points below which each is simulated separately
_AT_ONCE = 16  # largest number of points in one pass if whole paths must be kept


def chi2_of(
    problem: EstimationProblem, points: Float[np.ndarray, "K P"], weighted: WeightedData
) -> Float[np.ndarray, " K"]:
    """chi2 = sum r^2 + sum ((x - mean) / sd)^2 at many points.

    Args:
        points: coordinates, shape (K, P).
        weighted: data, whitening and priors, see `EstimationProblem.weighted`.
    Returns:
        Shape (K,), dimensionless; inf if the simulation fails.
    """
    form = problem.layout.form
    if available():
        with np.errstate(over="ignore", invalid="ignore"):  # simulations that diverge
            padded = problem.layout.padded(points)
            prior = np.sum(prior_residual_here(padded, weighted) ** 2, axis=-1)
            chi2 = prior + residual_kernels.chi2_of_points(form, form.full(padded, weighted.pick), weighted)
            return np.where(np.isfinite(chi2), chi2, np.inf)
    if len(points) < _FEW:  # the program for one residual is used, for any number of points
        return np.array([_of_one(problem, x, weighted) for x in points])
    passes = max(-(-len(points) // _MOST), min(CORES, len(points) // _LEAST))
    size = -(-len(points) // passes)
    spare = np.repeat(points[-1:], passes * size - len(points), axis=0)  # so that all passes have one size
    full = problem.layout.padded(np.concatenate((points, spare)))
    parts = side_by_side(lambda some: _chi2(form, some, weighted), np.split(full, passes))
    chi2 = np.concatenate([np.asarray(part) for part in parts])[: len(points)]
    return np.where(np.isfinite(chi2), chi2, np.inf)


def _of_one(problem: EstimationProblem, x: Float[np.ndarray, " P"], weighted: WeightedData) -> float:
    prior = prior_residual_here(problem.layout.padded(x), weighted)
    chi2 = problem.chi2(x, weighted) + float(np.sum(prior**2))
    return chi2 if np.isfinite(chi2) else np.inf


@partial(jax.jit, static_argnums=0)
def _chi2(form: Form, points: Float[Array, "K P"], weighted: WeightedData) -> Float[Array, " K"]:
    """Shape (K, P) -> (K,)."""
    if not has_single_pass(form, weighted):
        return jax.lax.map(lambda x: _of_paths(form, x, weighted), points, batch_size=_AT_ONCE)
    prior = jax.vmap(lambda x: prior_residual(x, weighted))(points)
    return _in_one_pass(form, points, weighted) + jnp.sum(prior**2, axis=1)


def _of_paths(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Float[Array, ""]:
    return jnp.sum(residual(form, x, weighted) ** 2) + jnp.sum(prior_residual(x, weighted) ** 2)


def _in_one_pass(form: Form, points: Float[Array, "K P"], weighted: WeightedData) -> Float[Array, " K"]:
    """Sum of squared residuals, shape (K, P) -> (K,)."""
    values = jax.vmap(lambda x: form.values(x, weighted.pick))(points)
    shape, order = (weighted.steps.dt.shape[1], points.shape[0]), weighted.whitening.transition.shape[-1]
    step = partial(advance, form)
    each = jax.vmap(jax.vmap(step, in_axes=(0, 0, None)), in_axes=(None, 0, 0))

    def add(state: Any, entry: Any) -> Any:
        carried, chi2 = state
        carried, (_, r) = each(values, carried, entry)
        return (carried, chi2 + jnp.sum(r**2, axis=-1)), None

    first = start(form, values, shape, order), jnp.zeros(shape)
    return jnp.sum(jax.lax.scan(add, first, entries(weighted))[0][1], axis=0)
