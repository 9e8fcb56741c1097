"""Formulas of what a response shows: the paper's definitions (sections 4.1 and 4.3, Eq. 9), and what it costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...car_log.criteria import LEAST_HELD, LEAST_OVERSHOT, NEGLIGIBLE, SETTLED, TAIL
from .setpoint import Level, Setpoint, Stretch


class AtLevel(NamedTuple):
    """A response from a change of the setpoint to the next one.

    Args:
        size: of the change, share of the travel.
        since: s since the change began, shape (K,).
        beyond: how far the position lies beyond the new level, in the direction of the change, shares of the travel,
            shape (..., K).
        tail: number of the first tick of the level's last quarter.
    """

    size: float
    since: np.ndarray
    beyond: np.ndarray
    tail: int

    @classmethod
    def of(cls, level: Level, time: np.ndarray, share: np.ndarray) -> AtLevel:
        """Args: level; time: s, shape (K,); share: of the travel, shape (..., K)."""
        begin, end = index(time, level.begins), index(time, level.ends)
        beyond = (share[..., begin:end] - level.after) * np.sign(level.change)
        return cls(abs(level.change), time[begin:end] - level.begins, beyond, _tail(begin, end) - begin)

    @property
    def far(self) -> np.ndarray:
        """Distance from the level."""
        return np.abs(self.beyond)


class Run(NamedTuple):
    """A whole response.

    Args:
        setpoint: that it follows.
        time: s, shape (K,).
        duty: share of the supply, shape (..., K).
        current: A, shape (..., K).
    """

    setpoint: Setpoint
    time: np.ndarray
    duty: np.ndarray
    current: np.ndarray


def overshoot(at: AtLevel) -> np.ndarray:
    """%, of the change."""
    return 100.0 * np.maximum(np.max(at.beyond, axis=-1), 0.0) / max(at.size, LEAST_OVERSHOT)


def settling(at: AtLevel) -> np.ndarray:
    """s, until the first tick after the last one outside."""
    since = np.append(at.since, np.inf)
    outside = at.far > max(SETTLED * at.size, NEGLIGIBLE)
    last = outside.shape[-1] - np.argmax(outside[..., ::-1], axis=-1)
    return np.where(outside.any(axis=-1), since[last], 0.0)


def steady_state_error(at: AtLevel) -> np.ndarray:
    """%, of the change."""
    return 100.0 * np.max(at.far[..., at.tail :], axis=-1) / max(at.size, LEAST_HELD)


def tracking_error(setpoint: Setpoint, stretch: Stretch, time: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Root mean square over a stretch, % of the travel (Eq. 9)."""
    part = slice(index(time, stretch.begins), index(time, stretch.ends))
    return 100.0 * np.sqrt(np.mean(np.square(share[..., part] - setpoint.at(time[part])), axis=-1))


def duty_activity(run: Run) -> np.ndarray:
    """Standard deviation of the duty in the last quarter of a level, root mean square of all levels, %."""
    ends = ((index(run.time, level.begins), index(run.time, level.ends)) for level in run.setpoint.levels)
    moved = [np.var(run.duty[..., _tail(begin, end) : end], axis=-1) for begin, end in ends]
    return 100.0 * np.sqrt(np.mean(np.stack(moved), axis=0))


def current_rms(run: Run) -> np.ndarray:
    """A."""
    judged = run.current[..., index(run.time, run.setpoint.judged_from) :]
    return np.sqrt(np.mean(np.square(judged), axis=-1))


def index(time: np.ndarray, instant: float) -> int:
    """First tick at or after an instant (s)."""
    return int(np.searchsorted(time, instant - 0.5 * (time[1] - time[0])))


def _tail(begin: int, end: int) -> int:
    """First tick of a level's last quarter."""
    return begin + round((1.0 - TAIL) * (end - begin))
