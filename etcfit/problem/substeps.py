"""How many integration steps each interval between samples needs."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..model.effects import State
from ..model.stepper import Step, step
from ..model.throttle import Throttle
from .batch import TraceBatch
from .process_noise import before_steps, impact_nearby, slot_senses

TOLERANCE = 0.002  # local error of a step, in standard deviations of a sample
_MOST = 24  # steps in one interval
_LASTING = 0.03  # s, for how long an error in speed moves the angle


def local_error(throttle: Throttle, path: Any, batch_steps: Step, batch: tuple[Any, ...]) -> Any:
    """Error of each step by step doubling, in standard deviations of the samples, shape (T, L).

    Args:
        throttle: the model.
        path: its path along the batch.
        batch_steps: steps with their circuits.
        batch: (resets, slots).
    """
    resets, slots = batch
    x, z = before_steps(throttle, path, resets)

    def difference(x: State, z: Any, s: Step) -> Any:
        early, late = s.halves()
        whole, _ = step(throttle, x, z, s)
        half, _ = step(throttle, *step(throttle, x, z, early), late)
        return jnp.stack(whole) - jnp.stack(half)

    wrong = jax.vmap(jax.vmap(difference))(x, z, batch_steps)
    # an error in speed goes on to move the angle
    wrong = wrong.at[..., 1].add(_LASTING * wrong[..., 2])
    seen = slot_senses(throttle, path, batch_steps, slots)[..., :3]
    present = jnp.any(slots.weight > 0.0, axis=0)  # a slot that is used anywhere in the lane
    each = jnp.abs(jnp.einsum("tlmn,tln->tlm", seen, wrong)) / slots.sigma
    # around an impact the samples are discounted, and no number of steps makes a clipped impact smooth
    smooth = impact_nearby(x, path[0], batch_steps, slots) == 0.0
    return jnp.where(smooth, jnp.max(jnp.where(present, each, 0.0), axis=-1), 0.0)


def substeps_needed(batch: TraceBatch, error: np.ndarray) -> list[np.ndarray]:
    """Steps in each interval that bring the local error under `TOLERANCE`.

    Args:
        batch: as it is.
        error: of each of its steps, shape (T, L), see `local_error`.
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
