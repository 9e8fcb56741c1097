"""How well a response follows its setpoint: the paper's definitions (sections 4.1 and 4.3, Eq. 9)."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .setpoint import Level, Setpoint

SETTLED = 0.02  # of the change of the setpoint
TAIL = 0.25  # of a level, at its end, over which the steady-state error is looked for


class Judged(NamedTuple):
    """A response's figures; the worst of all levels, and the RMSE over all of them. See `base.Metrics`."""

    overshoot_pct: Any
    settling_s: Any
    steady_state_error_pct: Any
    rmse_pct: Any


def judge(setpoint: Setpoint, time: np.ndarray, share: Any) -> Judged:
    """Judge a response.

    Args:
        setpoint: what was asked for.
        time: s, shape (K,), from 0 with an even step.
        share: of the travel, shape (..., K).
    """
    each = [_level(level, time, share) for level in setpoint.levels]
    worst = [jnp.max(jnp.stack(column), axis=0) for column in zip(*each, strict=True)]
    seen = time >= setpoint.judged_from
    error = share[..., seen] - setpoint.at(time[seen])
    return Judged(*worst, 100.0 * jnp.sqrt(jnp.mean(jnp.square(error), axis=-1)))


def _level(level: Level, time: np.ndarray, share: Any) -> tuple[Any, Any, Any]:
    """Overshoot %, settling time s, steady-state error %."""
    half = 0.5 * (time[1] - time[0])
    seen = (time > level.begins - half) & (time < level.ends - half)
    since = time[seen] - level.begins
    beyond = (share[..., seen] - level.after) / (level.after - level.before)
    overshoot = 100.0 * jnp.maximum(jnp.max(beyond, axis=-1), 0.0)
    off = jnp.abs(beyond) > SETTLED
    # it has settled at the first sample after the last one outside
    after = jnp.asarray(np.append(since[1:], np.inf))
    settling = jnp.max(jnp.where(off, after, 0.0), axis=-1)
    tail = jnp.abs(beyond[..., since > (1.0 - TAIL) * (level.ends - level.begins)])
    return overshoot, settling, 100.0 * jnp.max(tail, axis=-1)
