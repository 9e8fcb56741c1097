"""How well a response follows its setpoint: the paper's definitions (sections 4.1 and 4.3, Eq. 9)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...car_log.criteria import LEAST_HELD, LEAST_OVERSHOT, NEGLIGIBLE, SETTLED, TAIL
from .setpoint import Level, Setpoint, Stretch


class Judged(NamedTuple):
    """A response's figures; the worst of all levels, and the worst RMSE of its stretches. See `base.Metrics`."""

    overshoot_pct: Any
    settling_s: Any
    steady_state_error_pct: Any
    rmse_pct: Any


class Effort(NamedTuple):
    """What a response costs. See `base.Metrics`."""

    duty_activity_pct: Any
    current_rms_A: Any


class Figures(NamedTuple):
    """Both, and the heat that the current makes, W. See `base.Metrics`."""

    overshoot_pct: Any
    settling_s: Any
    steady_state_error_pct: Any
    rmse_pct: Any
    duty_activity_pct: Any
    current_rms_A: Any
    winding_W: Any
    bridge_W: Any


def judge(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> Judged:
    """Judge a response.

    Args:
        setpoint: what was asked for.
        time: s, shape (K,), from 0 with an even step.
        share: of the travel, shape (..., K); what is not finite counts as infinitely far off.
    """
    share = np.where(np.isfinite(share), share, np.inf)
    missed = [_missed(setpoint, stretch, time, share) for stretch in setpoint.stretches]
    return Judged(*_worst(setpoint.levels, time, share), np.max(np.stack(missed), axis=0))


def judge_each(setpoint: Setpoint, time: np.ndarray, share: np.ndarray) -> dict[str, Judged]:
    """The same scenario by scenario, each with the tracking error over all of its own.

    Of a log, which has no levels, there is nothing but the tracking error; the others are NaN.
    """
    share = np.where(np.isfinite(share), share, np.inf)
    out = {}
    for name in setpoint.scenarios:
        levels = setpoint.only(name)
        parts = [part for part in (*levels, *setpoint.stretches) if part.scenario == name]
        whole = Stretch(min(part.begins for part in parts), max(part.ends for part in parts))
        nothing = np.full(share.shape[:-1], np.nan)
        worst = _worst(levels, time, share) if levels else _LevelFigures(nothing, nothing, nothing)
        out[name] = Judged(*worst, _missed(setpoint, whole, time, share))
    return out


def effort(setpoint: Setpoint, time: np.ndarray, duty: np.ndarray, current: np.ndarray) -> Effort:
    """What a response costs.

    Args:
        setpoint: what was asked for.
        time: s, shape (K,), from 0 with an even step.
        duty: shares of the supply, shape (..., K).
        current: A, shape (..., K).
    """
    tails = [duty[..., slice(*_tail(level, time))] for level in setpoint.levels]
    moved = np.mean(np.stack([np.var(tail, axis=-1) for tail in tails]), axis=0)
    spent = np.mean(np.square(current[..., _index(time, setpoint.judged_from) :]), axis=-1)
    return Effort(100.0 * np.sqrt(moved), np.sqrt(spent))


def _missed(setpoint: Setpoint, stretch: Stretch, time: np.ndarray, share: np.ndarray) -> np.ndarray:
    """RMS of the tracking error over a stretch, % of the travel."""
    part = slice(_index(time, stretch.begins), _index(time, stretch.ends))
    return 100.0 * np.sqrt(np.mean(np.square(share[..., part] - setpoint.at(time[part])), axis=-1))


def _worst(levels: tuple[Level, ...], time: np.ndarray, share: np.ndarray) -> _LevelFigures:
    each = [_level(level, time, share) for level in levels]
    return _LevelFigures(*(np.max(np.stack(column), axis=0) for column in zip(*each, strict=True)))


def _index(time: np.ndarray, instant: float) -> int:
    """First tick at or after an instant (s)."""
    return int(np.searchsorted(time, instant - 0.5 * (time[1] - time[0])))


class _LevelFigures(NamedTuple):
    """Of one level, shape (...,) each."""

    overshoot_pct: np.ndarray
    settling_s: np.ndarray
    steady_state_error_pct: np.ndarray


def _tail(level: Level, time: np.ndarray) -> tuple[int, int]:
    """First tick of a level's tail, and the one after its last."""
    begin, end = _index(time, level.begins), _index(time, level.ends)
    return begin + round((1.0 - TAIL) * (end - begin)), end


def _level(level: Level, time: np.ndarray, share: np.ndarray) -> _LevelFigures:
    begin, end = _index(time, level.begins), _index(time, level.ends)
    size, beyond = abs(level.change), (share[..., begin:end] - level.after) * np.sign(level.change)
    overshoot = 100.0 * np.maximum(np.max(beyond, axis=-1), 0.0) / max(size, LEAST_OVERSHOT)
    far = np.abs(beyond)
    # it has settled at the first tick after the last one outside
    since = np.append(time[begin:end] - level.begins, np.inf)
    outside = far > max(SETTLED * size, NEGLIGIBLE)
    last = outside.shape[-1] - np.argmax(outside[..., ::-1], axis=-1)
    settling = np.where(outside.any(axis=-1), since[last], 0.0)
    held = np.max(far[..., _tail(level, time)[0] - begin :], axis=-1)
    return _LevelFigures(overshoot, settling, 100.0 * held / max(size, LEAST_HELD))
