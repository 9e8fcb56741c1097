"""Number of integration steps for each interval between samples."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..model.effects import State
from ..model.parameters import AnyArray, Scalar
from ..model.stepper import StatePath, Step, step
from ..model.throttle import Throttle
from .batch import BatchArrays, SampleSlots, TraceBatch
from .process_noise import before_steps, impact, impacts_nearby, slot_senses

TOLERANCE = 0.002  # local error of a step, in standard deviations of a sample
_MOST = 24  # largest number of steps in one interval
_LASTING = 0.03  # s, time during which an error in speed moves the angle


def local_error(throttle: Throttle, path: StatePath, batch: BatchArrays) -> Float[Array, "T L"]:
    """Integration error of each step, from the difference between one step and two of half its length.

    Args:
        path: its states and memories at the end of each step, shape (T, L) each.
        batch: the batch with the rig's effects and the guide's lever, see `residual.run`.
    Returns:
        Shape (T, L), in standard deviations of the samples.
    """
    steps, resets, slots, _, test_of = batch
    x, z = before_steps(throttle, path, steps, resets)
    # entry by entry: a loop over one entry's lanes compiles in a fraction of the time for whole arrays
    each = jax.vmap(partial(step_error, throttle))
    error = jax.lax.map(lambda entry: each(*entry), (x, z, steps, slots, test_of))
    nearby = impacts_nearby(impact(x, path[0], steps), slots.weight)
    return worst(error, slots.weight, nearby)


def step_error(
    throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, slots: SampleSlots, test_of: Scalar
) -> Float[AnyArray, " M"]:
    """Integration error of one step in each slot's value, shape (M,), in standard deviations of a sample."""
    halves = jax.tree.map(lambda *each: jnp.stack(each), *s.halves())
    whole, _ = step(throttle, x, z, s)
    (half, _), _ = jax.lax.scan(lambda carry, each: (step(throttle, *carry, each), None), (x, z), halves)
    wrong = State(*(a - b for a, b in zip(whole, half, strict=True)))
    # an error in speed continues to move the angle
    wrong = jnp.stack(wrong._replace(theta=wrong.theta + _LASTING * wrong.omega))
    return jnp.abs(slot_senses(throttle, s, slots, test_of)[:, :3] @ wrong) / slots.sigma


def worst(
    error: Float[AnyArray, "T L M"], weight: Float[AnyArray, "T L M"], nearby: Float[AnyArray, "T L"], by: Any = jnp
) -> Float[AnyArray, "T L"]:
    """The largest error of each step among the slots that are used anywhere in the lane.

    It is 0 around an impact, where samples have less weight and no number of steps makes a clipped impact smooth.

    Args:
        error: see `step_error`.
        weight: weights of the samples, 0 without a sample.
        nearby: see `process_noise.impacts_nearby`.
        by: JAX or NumPy.
    """
    present = by.any(weight > 0.0, axis=0)
    return by.where(nearby == 0.0, by.max(by.where(present, error, 0.0), axis=-1), 0.0)


def substeps_needed(batch: TraceBatch, error: Float[np.ndarray, "T L"]) -> list[Int[np.ndarray, " _"]]:
    """Steps in each interval that bring the local error under `TOLERANCE`.

    Args:
        batch: the batch with the present steps.
        error: error of each of its steps, in standard deviations of the samples, see `local_error`.
    Returns:
        For each trace shape (n - 1,).
    """
    out = []
    for lane, row, marks in batch.places:
        column = error[row : row + (marks[-1] - row) + 1, lane]
        starts = marks[:-1] - row + 1
        worst = np.maximum.reduceat(column, starts)
        count = np.diff(marks)
        with np.errstate(over="ignore"):  # a simulation that diverges
            factor = np.ceil(count * np.cbrt(worst / TOLERANCE))
        out.append(np.clip(np.where(np.isfinite(factor), factor, _MOST), 1, _MOST).astype(int))
    return out
