"""How closely the plate follows its setpoint: errors over a whole log and in parts of the travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rig.signals import runs
from .criteria import FAR, SETTLING
from .log import Series

_LONGEST = 1.0  # s: largest lag that is tried
_BLOCK = 5.0  # s: errors further apart are independent
_FEWEST = 4  # least number of blocks for a standard error
_WITHIN = 5.834  # solution a of (1 + a) exp(-a) = 0.02: a critically damped loop has settled then
_RANGE = 20.0  # per cent of travel
_STILL = 0.5  # per cent: a setpoint that varies by less shows no lag


@dataclass(frozen=True)
class InRange:
    """Error of the position while the setpoint lies in a part of the travel."""

    # low, high: of the setpoint, per cent
    low: float
    high: float
    seconds: float  # time of the setpoint in it
    rmse: float  # per cent of travel
    mean: float  # of position - setpoint, per cent of travel


@dataclass(frozen=True)
class Tracking:
    """Error of the position against the setpoint."""

    rmse: float  # Eq. 9, per cent of travel.
    stderr: float | None  # of it, from blocks of 5 s; None for a log of fewer than four
    lag: float | None  # by which the position comes after the setpoint, s; None where the setpoint hardly moves
    lag_stderr: float | None  # of it, from the same blocks
    left: float | None  # RMSE against the setpoint delayed by the lag: the part of the error that is not delay
    demand: float  # root mean square of the setpoint's rate, per cent a second: a slower drive is easier to follow
    astray: float = 0.0  # longest time with an error above 10 % of travel, s
    # error on this setpoint of a critically damped second-order loop that settles in 0.2 s, per cent of travel
    within_reach: float = 0.0
    ranges: tuple[InRange, ...] = ()  # parts of the travel in which the setpoint was for half a second or more


def tracking(position: Series, setpoint: Series) -> Tracking:
    """Compare position and setpoint where both were logged.

        RMSE = sqrt(sum (Y - Y_set)^2 / N),    lag = argmin_d sum (Y(t) - Y_set(t - d))^2

    Source: paper, Eq. 9. Differs from source: the setpoint is interpolated to the position's times; the lag is ours.
    """
    seen = (position.time >= setpoint.time[0]) & (position.time <= setpoint.time[-1])
    time, value = position.time[seen], position.value[seen]
    wanted = np.interp(time, setpoint.time, setpoint.value)
    error = value - wanted
    rate = np.diff(wanted) / np.diff(time)
    lag, lag_stderr = _lag(time, value, setpoint) if wanted.std() > _STILL else (None, None)
    left = None if lag is None else _left(time, value, setpoint, lag)
    return Tracking(_rms(error), _stderr(time, error), lag, lag_stderr, left, _rms(rate),
                    longest(time, np.abs(error) > FAR), _within_reach(time, wanted),
                    _ranges(time, wanted, error))  # fmt: skip


def longest(time: np.ndarray, there: np.ndarray) -> float:
    """The longest time for which a condition holds without a break, s."""
    return max((float(time[b - 1] - time[a]) for a, b in runs(there)), default=0.0)


def _within_reach(time: np.ndarray, wanted: np.ndarray) -> float:
    """RMS of y - r of y'' = w^2 (r - y) - 2 w y', w = 5.834/0.2 s, the setpoint r held between samples.

    Solved step by step: x = y - r is (x_0 + (v_0 + w x_0) t) exp(-w t).
    """
    w = _WITHIN / SETTLING.limit
    steps = np.diff(time)
    fades, slopes = np.exp(-w * steps).tolist(), steps.tolist()
    y, v, missed = float(wanted[0]), 0.0, [0.0]
    for fade, step, before, now in zip(fades, slopes, wanted[:-1].tolist(), wanted[1:].tolist(), strict=True):
        x = y - before
        both = v + w * x
        y, v = before + (x + both * step) * fade, (v - w * both * step) * fade
        missed.append(y - now)
    return _rms(np.array(missed))


def _ranges(time: np.ndarray, wanted: np.ndarray, error: np.ndarray) -> tuple[InRange, ...]:
    weight = Series(time, error).weight
    out = []
    for low in np.arange(0.0, 100.0, _RANGE):
        inside = (wanted >= low) & ((wanted < low + _RANGE) | (low + _RANGE >= 100.0))
        seconds = float(weight[inside].sum())
        if seconds >= 0.5:
            out.append(
                InRange(float(low), float(low + _RANGE), seconds, _rms(error[inside]), float(error[inside].mean()))
            )
    return tuple(out)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _lag(time: np.ndarray, value: np.ndarray, setpoint: Series) -> tuple[float, float | None]:
    """The best of many delays, and its standard error: the jackknife over blocks, None for fewer than four.

    Source: Miller 1974, Biometrika 61(1), for the jackknife. Differs from source: blocks of 5 s are left out.
    """
    step = min(float(np.median(np.diff(time))), 0.01)
    delays = step * np.arange(-round(0.1 / step), round(_LONGEST / step) + 1)
    inside = (time - delays[0] <= setpoint.time[-1]) & (time - delays[-1] >= setpoint.time[0])
    t, y = time[inside], value[inside]
    if t.size < 2:
        return 0.0, None
    block = np.unique(_blocks(t), return_inverse=True)[1]
    missed = ((y - np.interp(t - d, setpoint.time, setpoint.value)) ** 2 for d in delays)
    costs = np.array([np.bincount(block, each) for each in missed])  # a row a delay, a column a block
    lag, count = _lowest(delays, costs.sum(axis=1)), costs.shape[1]
    if count < _FEWEST:
        return lag, None
    without = np.array([_lowest(delays, costs.sum(axis=1) - column) for column in costs.T])
    return lag, float(np.sqrt((count - 1) * np.mean((without - without.mean()) ** 2)))


def _blocks(time: np.ndarray) -> np.ndarray:
    """Number of the block in which each instant (s) lies."""
    return ((time - time[0]) // _BLOCK).astype(int)


def _lowest(delays: np.ndarray, cost: np.ndarray) -> float:
    """The delay of least cost, on a parabola through it and its neighbours; evenly spaced, s."""
    k = int(np.clip(np.argmin(cost), 1, delays.size - 2))
    bend = cost[k - 1] - 2.0 * cost[k] + cost[k + 1]
    shift = 0.5 * (cost[k - 1] - cost[k + 1]) / bend if bend > 0.0 else 0.0
    return float(delays[k] + (delays[1] - delays[0]) * np.clip(shift, -1.0, 1.0))


def _left(time: np.ndarray, value: np.ndarray, setpoint: Series, lag: float) -> float:
    there = (time - lag >= setpoint.time[0]) & (time - lag <= setpoint.time[-1])
    return _rms((value - np.interp(time - lag, setpoint.time, setpoint.value))[there])


def _stderr(time: np.ndarray, error: np.ndarray) -> float | None:
    """Of the RMSE, by the delta method from the scatter of the blocks' mean squares."""
    block = _blocks(time)
    squares = np.array([np.mean(error[block == k] ** 2) for k in np.unique(block)])
    if squares.size < _FEWEST:
        return None
    return float(squares.std(ddof=1) / np.sqrt(squares.size) / (2.0 * max(_rms(error), 1e-12)))
