"""The residual and its Jacobian, and the normal equations for a least-squares step: J^T J and J^T r.

A tangent for each parameter is carried along the batch together with the simulation, through observation and whitening;
no part of the simulation is computed twice, and no path is kept. Lanes are distributed over the cores.

Source: Griewank and Walther 2008, ch. 3 (vector forward mode). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..kernels.machine import available
from ..model.parameters import AnyArray
from . import residual_kernels
from .cores import CORES, side_by_side
from .free_parameters import Form
from .jacobian import jacobian
from .one_pass import Carried, advance, entries, has_single_pass, start
from .residual import WeightedData, residual

LEAST_LANES = 4  # least number of lanes in one piece: fewer do not fill the processor's vectors
MOST_BYTES = 64 << 20  # largest size of a piece's Jacobian


class NormalEquations(NamedTuple):
    """Normal equations of a residual r and its Jacobian J at a point: (J^T J) d = -J^T r. Dimensionless."""

    chi2: Float[AnyArray, ""]  # r^T r
    gradient: Float[AnyArray, " P"]  # J^T r, shape (P,)
    information: Float[AnyArray, "P P"]  # J^T J, shape (P, P)

    @property
    def finite(self) -> bool:
        """Whether residual and Jacobian are finite; False if a simulation failed."""
        return bool(np.isfinite(self.chi2) and np.isfinite(self.information).all() and np.isfinite(self.gradient).all())


class Linearised(NamedTuple):
    """A residual and its Jacobian over coordinates, dimensionless."""

    r: Float[AnyArray, "T L M"]  # whitened residual, shape (T, L, M)
    jacobian: Float[AnyArray, "T P L M"]  # dr/dx, shape (T, P, L, M)
    equations: NormalEquations  # r^T r, J^T r and J^T J of both


def shared_out(
    weighted: WeightedData, size: int, cores: int = CORES, least_lanes: int = LEAST_LANES, most_bytes: int = MOST_BYTES
) -> tuple[WeightedData, ...]:
    """The data in pieces of some lanes each, all of one shape, for the cores to process in parallel.

    Args:
        weighted: data, whitening and priors of the whole batch.
        size: number of coordinates P; the Jacobian grows with it.
        least_lanes: least number of lanes of a piece.
        most_bytes: largest size of its Jacobian.
    Returns:
        At least one piece; lanes that only fill the last one have weight 0.
    """
    steps, lanes, slots = weighted.slots.value.shape
    fill = -(-lanes // least_lanes)
    count = max(min(cores, fill), -(-8 * steps * lanes * slots * size // most_bytes))
    width = -(-lanes // min(count, lanes))

    def lanes_of(leaf: Any, first: int) -> Any:
        if np.ndim(leaf) < 2:  # a prior or a choice of parameters: the same for all pieces
            return leaf
        part = np.asarray(leaf)[:, first : first + width]
        return np.pad(part, [(0, 0), (0, width - part.shape[1])] + [(0, 0)] * (part.ndim - 2), mode="edge")

    def piece(first: int) -> WeightedData:
        part = jax.tree.map(partial(lanes_of, first=first), weighted)
        if first + width > lanes:  # lanes that only fill the piece have weight 0
            part.whitening.weight[:, lanes - first :] = 0.0
        return jax.device_put(part)

    if width == lanes:
        return (jax.device_put(weighted),)
    return tuple(piece(first) for first in range(0, lanes, width))


def normal_equations(
    form: Form, weighted: WeightedData, size: int
) -> Callable[[Float[np.ndarray, " P"]], NormalEquations]:
    """A function that computes r^T r, J^T r and J^T J of the samples at coordinates x, shape (P,), without priors.

    Args:
        weighted: data, whitening and priors of the whole batch.
        size: number of coordinates P.
    """
    if available():
        return partial(_by_kernel, form, weighted)
    pieces = shared_out(weighted, size)

    def by_jax(x: Float[np.ndarray, " P"]) -> NormalEquations:
        parts = side_by_side(lambda piece: linearise(form, x, piece).equations, pieces)
        return NormalEquations(
            *(np.sum([np.asarray(term) for term in terms], axis=0) for terms in zip(*parts, strict=True))
        )

    return by_jax


def _by_kernel(form: Form, weighted: WeightedData, x: Float[np.ndarray, " P"]) -> NormalEquations:
    found, slope = residual_kernels.sums(form, form.full(x, weighted.pick), weighted), form.slopes(x, weighted.pick)
    gradient, information = np.zeros(x.size), np.zeros((x.size, x.size))
    live = np.flatnonzero(form.live(weighted.pick))
    with np.errstate(over="ignore", invalid="ignore"):  # a divergence gives inf or NaN, as by JAX
        gradient[live] = slope[live] * found.gradient
        information[np.ix_(live, live)] = np.outer(slope[live], slope[live]) * found.information
    return NormalEquations(found.chi2, gradient, information)


def linearised(
    form: Form, x: Float[AnyArray, " P"], weighted: WeightedData
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "T L M P"]]:
    """Whitened residual of the samples and its Jacobian.

    Args:
        x: coordinates, shape (P,).
        weighted: data, whitening and priors of the whole batch.
    Returns:
        The residual r, shape (T, L, M), and dr/dx, shape (T, L, M, P), dimensionless.
    """
    if available():
        r, slopes = residual_kernels.linearised(form, form.full(x, weighted.pick), weighted)
        live = np.flatnonzero(form.live(weighted.pick))
        with np.errstate(over="ignore", invalid="ignore"):  # as above
            slopes *= form.slopes(x, weighted.pick)[live]
        if live.size == x.size:  # it has the size of all samples times parameters: avoid a copy
            return r, slopes
        columns = np.zeros((*r.shape, x.size))
        columns[..., : live.size] = slopes
        return r, columns
    parts = side_by_side(lambda piece: linearise(form, x, piece), shared_out(weighted, x.size))
    lanes = weighted.slots.value.shape[1]
    r = np.concatenate([np.asarray(part.r) for part in parts], axis=1)[:, :lanes]
    columns = np.concatenate([np.moveaxis(np.asarray(part.jacobian), 1, 3) for part in parts], axis=1)[:, :lanes]
    return r, columns


@partial(jax.jit, static_argnums=0)
def linearise(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Linearised:
    """Residual, Jacobian and normal equations of one piece of the data, compiled.

    Args:
        x: coordinates, shape (P,).
        weighted: data, whitening and priors of some lanes.
    """
    if has_single_pass(form, weighted):
        r, columns = _in_one_pass(form, x, weighted)
    else:
        r, last = jacobian(lambda x: residual(form, x, weighted), x, form.live(weighted.pick))
        columns = jnp.moveaxis(last, 3, 1)
    flat = jnp.moveaxis(columns, 1, 3).reshape(-1, x.size)
    return Linearised(r, columns, NormalEquations(jnp.sum(r**2), flat.T @ r.ravel(), flat.T @ flat))


def _in_one_pass(
    form: Form, x: Float[Array, " P"], weighted: WeightedData
) -> tuple[Float[Array, "T L M"], Float[Array, "T P L M"]]:
    """Residual and Jacobian."""

    def valued(way: Any) -> Any:
        return jax.jvp(lambda x: form.values(x, weighted.pick), (x,), (way,))

    values, dvalues = jax.vmap(valued, out_axes=(None, 0))(jnp.eye(x.size))
    lanes, order = weighted.steps.dt.shape[1], weighted.whitening.transition.shape[-1]
    each = jax.vmap(partial(advance, form), in_axes=(None, 0, 0))

    def add(state: tuple[Carried, Carried], entry: Any) -> Any:
        carried, tangents = state

        def pushed(dvalues: Any, tangent: Carried) -> Any:
            return jax.jvp(lambda v, c: each(v, c, entry), (values, carried), (dvalues, tangent))

        (carried, (_, r)), (tangents, (_, dr)) = jax.vmap(pushed, out_axes=(None, 0))(dvalues, tangents)
        return (carried, tangents), (r, dr)

    first = start(form, values, (lanes,), order)
    still = jax.tree.map(lambda leaf: jnp.zeros((x.size, lanes)), first)
    return jax.lax.scan(add, (first, still), entries(weighted))[1]
