"""How many integration steps each interval between samples needs."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..model.effects import State
from ..model.parameters import Scalar
from ..model.stepper import StatePath, Step, step
from ..model.throttle import Throttle
from .batch import BatchArrays, TraceBatch
from .process_noise import before_steps, impact_nearby, slot_senses

TOLERANCE = 0.002  # local error of a step, in standard deviations of a sample
_MOST = 24  # steps in one interval
_LASTING = 0.03  # s, for how long an error in speed moves the angle


def local_error(throttle: Throttle, path: StatePath, batch: BatchArrays) -> Float[Array, "T L"]:
    """Integration error of each step, from one step against two of half its length.

    Args:
        throttle: the model.
        path: its states and memories at the end of each step, shape (T, L) each.
        batch: as the rig drives it and with the guide's lever, see `residual.run`.
    Returns:
        shape (T, L), in standard deviations of the samples.
    """
    slots = batch.slots
    x, z = before_steps(throttle, path, batch.resets)

    def difference(x: State, z: tuple[Scalar, ...], s: Step) -> Float[Array, " 3"]:
        halves = jax.tree.map(lambda *each: jnp.stack(each), *s.halves())
        whole, _ = step(throttle, x, z, s)
        (half, _), _ = jax.lax.scan(lambda carry, each: (step(throttle, *carry, each), None), (x, z), halves)
        return jnp.stack(whole) - jnp.stack(half)

    # entry by entry: a loop over one entry's lanes compiles in a fraction of the time that whole arrays take
    wrong = jax.lax.map(lambda entry: jax.vmap(difference)(*entry), (x, z, batch.steps))
    # an error in speed goes on to move the angle
    wrong = wrong.at[..., 1].add(_LASTING * wrong[..., 2])
    seen = slot_senses(throttle, batch.steps, slots, batch.test_of)[..., :3]
    present = jnp.any(slots.weight > 0.0, axis=0)  # a slot that is used anywhere in the lane
    each = jnp.abs(jnp.einsum("tlmn,tln->tlm", seen, wrong)) / slots.sigma
    # around an impact the samples are discounted, and no number of steps makes a clipped impact smooth
    smooth = impact_nearby(x, path[0], batch.steps, slots) == 0.0
    return jnp.where(smooth, jnp.max(jnp.where(present, each, 0.0), axis=-1), 0.0)


def substeps_needed(batch: TraceBatch, error: Float[np.ndarray, "T L"]) -> list[Int[np.ndarray, " _"]]:
    """Steps in each interval that bring the local error under `TOLERANCE`.

    Args:
        batch: with the number of steps to be changed.
        error: of each of its steps, in standard deviations of the samples, see `local_error`.
    Returns:
        for each trace shape (n - 1,).
    """
    out = []
    for lane, row, marks in batch.places:
        column = error[row : row + (marks[-1] - row) + 1, lane]
        starts = marks[:-1] - row + 1
        worst = np.maximum.reduceat(column, starts)
        count = np.diff(marks)
        factor = np.ceil(count * np.cbrt(worst / TOLERANCE))
        out.append(np.clip(np.where(np.isfinite(factor), factor, _MOST), 1, _MOST).astype(int))
    return out
