"""The duty of a log: how much it varies at rest, and when it is at its limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .log import Series
from .steps import rests
from .tracking import longest

_SETTLES = 0.5  # s of a rest in which the plate may still answer a step
_SAME = 0.5  # per cent: the duty is at its limit where it is this close to it
_IN_A_ROW = 3  # consecutive samples at a level that make it a limit
_HIGH = 40.0  # per cent: least limit of the duty


@dataclass(frozen=True)
class DutyUse:
    """The duty of a log."""

    # lowest, highest: per cent
    lowest: float
    highest: float
    activity: float | None  # standard deviation while the setpoint rests, per cent; None without a rest
    # jitter: change from sample to sample at rest, standard deviation over sqrt 2, per cent; None without a rest
    jitter: float | None
    limit: float | None  # |duty| at which the ECU limits it, per cent; None where this log shows no limit
    saturated: float  # share of the whole time at the limit, 0 to 1
    saturated_at_rest: float | None  # share of the time at rest, 0 to 1; None without a rest
    longest: float  # s at the limit without a break


def duty_use(duty: Series, setpoint: Series | None) -> DutyUse:
    """Evaluate a duty; rests count from 0.5 s after their begin.

    The limit is the largest |duty|, if three consecutive samples are within 0.5 % of it.
    """
    limit, at = _limit(duty.value)
    weight = duty.weight / duty.weight.sum()
    still = _at_rest(duty, setpoint)
    parts = [duty.value[part] for part in still if part.sum() >= _IN_A_ROW]
    resting = np.any(still, axis=0) if still else np.zeros(duty.time.size, dtype=bool)
    activity = (
        np.sqrt(np.average([part.var() for part in parts], weights=[part.size for part in parts])) if parts else None
    )
    jitter = np.std(np.concatenate([np.diff(part) for part in parts])) / np.sqrt(2.0) if parts else None
    return DutyUse(
        float(duty.value.min()), float(duty.value.max()),
        None if activity is None else float(activity), None if jitter is None else float(jitter),
        limit, float(weight[at].sum()),
        float(np.mean(at[resting])) if resting.any() else None, longest(duty.time, at),
    )  # fmt: skip


def _limit(value: np.ndarray) -> tuple[float | None, np.ndarray]:
    """The limit, and which samples are at it."""
    size = np.abs(value)
    limit = float(size.max())
    at = size >= limit - _SAME
    runs = np.convolve(at, np.ones(_IN_A_ROW), "valid")
    if limit < _HIGH or not np.any(runs >= _IN_A_ROW) or at.all():
        return None, np.zeros(value.size, dtype=bool)
    return limit, at


def _at_rest(duty: Series, setpoint: Series | None) -> list[np.ndarray]:
    """Which samples lie in each rest."""
    if setpoint is None:
        return []
    found = [rest for piece in setpoint.pieces if piece.time.size > 1 for rest in rests(piece)]
    return [(duty.time >= rest.begin + _SETTLES) & (duty.time <= rest.end) for rest in found
            if rest.end > rest.begin + _SETTLES]  # fmt: skip
