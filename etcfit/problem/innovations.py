"""The frozen whitening filter, which turns measured - simulated into independent standard normal residuals.

The simulation's error is correlated: a linear Gaussian process along its path (`process_noise`). The Kalman filter of
that process gives the innovations nu_k and their variances S_k:

    dx_k <- A_k dx_{k-1},    nu_k = y_k - y_hat_k - C_k dx_k,    dx_k <- dx_k + K_k nu_k,    r_k = nu_k / sqrt(S_k)

and the r_k are independent standard normal if the model is right. Weights and gains are frozen while the parameters
move (so the residual stays a plain function of the simulation, and no log-determinant is needed) and renewed between
rounds of the fit: this is the generalised least squares estimate, in which a noisy input widens the intervals but gives
no bias.

Source: Kailath 1968, An innovations approach to least-squares estimation. Differs from source: samples of one instant
are processed one after the other.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..model.parameters import AnyArray, Scalar
from ..model.stepper import StatePath
from ..model.tangents import fusion_barrier
from ..model.throttle import Throttle
from .batch import BatchArrays, SampleSlots
from .process_noise import ORDER, ErrorProcess, error_process


class Moved(NamedTuple):
    """Places in the batch of samples that the rig logs late, at the instants that they show, shape (T, L, M) each."""

    forth: Int[AnyArray, "T L M"]  # entry whose sample belongs at this one; T if there is none
    back: Int[AnyArray, "T L M"]  # entry at which this one's sample belongs; T if that is outside its trace


def shifted_samples_jax(array: Float[AnyArray, "T L M"], rows: Int[AnyArray, "T L M"]) -> Float[Array, "T L M"]:
    """An array with the values of other entries, shape (T, L, M); 0 for entry T."""
    array = jnp.asarray(array)
    padded = jnp.concatenate((array, jnp.zeros_like(array[:1])))
    return jnp.take_along_axis(padded, rows, axis=0)


def shifted_samples(
    arrays: Float[np.ndarray, "*K T L M"], rows: Int[np.ndarray, "T L M"]
) -> Float[np.ndarray, "*K T L M"]:
    """`shifted_samples_jax` for many arrays, by NumPy, because few samples move."""
    length, out = rows.shape[0], np.array(arrays)
    t, lane, m = np.nonzero(rows != np.arange(length)[:, None, None])
    where = rows[t, lane, m]
    out[..., t, lane, m] = np.where(where < length, arrays[..., np.minimum(where, length - 1), lane, m], 0.0)
    return out


class InnovationsFilter(NamedTuple):
    """A linear filter along the batch with n error states: current (A), angle (rad), speed (rad/s), memories of an ECU
    in the model, error of the input (V or N m). Formulas: head of this module.
    """

    transition: Float[AnyArray, "*batch n n"]  # A, shape (..., n, n); 0 at the first entry of a trace
    sense: Float[AnyArray, "*batch M n"]  # C, shape (..., M, n)
    gain: Float[AnyArray, "*batch M n"]  # K, shape (..., M, n)
    # 1 / sqrt(S), shape (..., M), 1 over the unit of the sample; 0 without a sample
    weight: Float[AnyArray, "*batch M"]
    moved: Moved | None = None  # places of late samples; None if no sample moves


def plain(slots: SampleSlots, order: int = ORDER) -> InnovationsFilter:
    """The filter r = (y - y_hat) / sigma, which treats samples as independent: for starts far from the truth, where
    errors of the model are larger than all errors in the Kalman filter.

    Args:
        slots: samples, shape (T, L, M).
        order: number n of error states, all 0 here; with the order of the model's Kalman filter both use one compiled
            program.
    """
    steps, lanes, count = slots.value.shape
    empty = _nothing((steps, lanes, count, order))
    weight = np.asarray(slots.weight) / np.asarray(slots.sigma)
    return InnovationsFilter(_nothing((steps, lanes, order, order)), empty, empty, weight)


def _nothing(shape: tuple[int, ...]) -> Float[np.ndarray, ...]:
    """Zeros that take no memory; the same array as long as it is in use, so that it is packed for a kernel only
    once."""
    kept = _NOTHING.get(shape)
    if kept is None:
        kept = _NOTHING[shape] = np.broadcast_to(0.0, shape)
    return kept


_NOTHING: WeakValueDictionary[tuple[int, ...], np.ndarray] = WeakValueDictionary()


def whiten(filter_: InnovationsFilter, error: Float[AnyArray, "T L M"]) -> Float[Array, "T L M"]:
    """r of a whole batch: innovations over their standard deviations.

    Args:
        error: measured - simulated, SI, 0 without a sample, shape (T, L, M).
    Returns:
        Shape (T, L, M), dimensionless; standard normal if the model is right.
    """
    if filter_.moved is not None:
        forth, back = filter_.moved
        there = shifted_samples_jax(error, forth)
        return shifted_samples_jax(whiten(filter_._replace(moved=None), there), back)
    filter_ = jax.tree.map(jnp.asarray, filter_)  # JAX does not accept the arrays of kernels
    start = tuple(jnp.zeros(error.shape[1]) for _ in range(filter_.transition.shape[-1]))
    return jax.lax.scan(lambda state, entry: innovate(state, *entry), start, (filter_, error))[1]


def innovate(
    state: tuple[Float[AnyArray, "*lanes"], ...], filter_: InnovationsFilter, error: Float[Array, "*lanes M"]
) -> tuple[tuple[Float[AnyArray, "*lanes"], ...], Float[Array, "*lanes M"]]:
    """Filter one entry of the batch.

    Args:
        state: the n error states before it, SI, all of one shape, such as (L,).
        filter_: the filter's matrices at that entry; leading axes as those of the state.
        error: measured - simulated, SI, shape (..., M).
    Returns:
        The error states after it, and r, shape (..., M), dimensionless.
    """
    transition, sense, gain, weight, _ = filter_
    order = range(len(state))
    state = fusion_barrier(tuple(sum(transition[..., p, q] * state[q] for q in order) for p in order))
    out = []
    for m in range(error.shape[-1]):
        here = weight[..., m]
        nu = fusion_barrier(jnp.where(here > 0.0, error[..., m] - sum(sense[..., m, q] * state[q] for q in order), 0.0))
        state = tuple(state[q] + gain[..., m, q] * nu for q in order)
        out.append(nu * here)
    return state, jnp.stack(out, axis=-1)


def kalman(
    throttle: Throttle, path: StatePath, batch: BatchArrays, jitter: Scalar
) -> tuple[InnovationsFilter, Float[Array, "T L M"]]:
    """The Kalman filter of the simulation's error, linearised along a simulated path.

    Args:
        throttle: the model at the parameters to linearise about.
        path: its states and memories at the end of each step, shape (T, L) each.
        batch: the batch with the rig's effects and the guide's lever, see `residual.run`.
        jitter: standard deviation of the sampling instants, as a share of the time between samples.
    Returns:
        The filter, and (dy/dt dt)^2 / S of each sample, shape (T, L, M): the variance that a jitter of 1 would add,
        over the variance S of its innovation.
    """
    process = error_process(throttle, path, batch)

    def advance(covariance: Any, entry: Any) -> Any:
        return jax.vmap(partial(renewed, jitter=jitter))(covariance, *entry)

    lanes, order = process.transition.shape[1:3]
    start = jnp.zeros((lanes, order, order))
    return jax.lax.scan(advance, start, (process, batch.slots.weight))[1]


def renewed(
    covariance: Float[AnyArray, "n n"], process: ErrorProcess, present: Float[AnyArray, " M"], jitter: Scalar
) -> tuple[Float[AnyArray, "n n"], tuple[InnovationsFilter, Float[AnyArray, " M"]]]:
    """One entry of the Riccati recursion, one slot after the other.

    Args:
        covariance: of the error after the entry before, P, shape (n, n).
        process: error process of this entry.
        present: 1 if a slot has a sample, shape (M,).
        jitter: see `kalman`.
    Returns:
        P after this entry, and the entry's part of the result of `kalman`.
    """
    a, sense, variance = process.transition, process.sense, process.sample_variance(jitter)
    covariance = a @ covariance @ a.T + process.noise
    gains, weights = [], []
    for m in range(sense.shape[0]):
        row = covariance @ sense[m]
        spread = row @ sense[m] + variance[m]
        gain = jnp.where(present[m] > 0.0, row / spread, 0.0)
        covariance = covariance - gain[:, None] * row[None, :]
        covariance = 0.5 * (covariance + covariance.T)
        gains.append(gain)
        weights.append(jnp.where(present[m] > 0.0, 1.0 / jnp.sqrt(spread), 0.0))
    weight = jnp.stack(weights)
    return covariance, (InnovationsFilter(a, sense, jnp.stack(gains), weight), process.timing * weight**2)
