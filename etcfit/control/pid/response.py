"""How well a response follows its setpoint: the paper's definitions (sections 4.1 and 4.3, Eq. 9)."""

from __future__ import annotations

from typing import Any, NamedTuple

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


def judge(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> Judged:
    """Judge a response.

    Args:
        setpoint: what was asked for.
        time: s, shape (K,), from 0 with an even step.
        share: of the travel, shape (..., K); what is not finite counts as infinitely far off.
    """
    share = np.where(np.isfinite(share), share, np.inf)
    each = [_level(level, time, share) for level in setpoint.levels]
    overshoot, settling, error = (np.max(np.stack(column), axis=0) for column in zip(*each, strict=True))
    begin = _index(time, setpoint.judged_from)
    missed = share[..., begin:] - setpoint.at(time[begin:])
    return Judged(overshoot, settling, error, 100.0 * np.sqrt(np.mean(np.square(missed), axis=-1)))


def _index(time: np.ndarray, instant: float) -> int:
    """First tick at or after an instant (s)."""
    return int(np.searchsorted(time, instant - 0.5 * (time[1] - time[0])))


class _LevelFigures(NamedTuple):
    """Of one level, shape (...,) each."""

    overshoot_pct: np.ndarray
    settling_s: np.ndarray
    steady_state_error_pct: np.ndarray


def _level(level: Level, time: np.ndarray, share: np.ndarray) -> _LevelFigures:
    begin, end = _index(time, level.begins), _index(time, level.ends)
    beyond = (share[..., begin:end] - level.after) / (level.after - level.before)
    overshoot = 100.0 * np.maximum(np.max(beyond, axis=-1), 0.0)
    far = np.abs(beyond)
    # it has settled at the first tick after the last one outside
    since = np.append(time[begin:end] - level.begins, np.inf)
    outside = far > SETTLED
    last = outside.shape[-1] - np.argmax(outside[..., ::-1], axis=-1)
    settling = np.where(outside.any(axis=-1), since[last], 0.0)
    tail = round((1.0 - TAIL) * (end - begin))
    return _LevelFigures(overshoot, settling, 100.0 * np.max(far[..., tail:], axis=-1))
