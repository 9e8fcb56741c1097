"""What drove the plate: the logged input, freed of its measurement noise as far as the log itself allows.

The logged voltage is a measurement of the true input, and the model's dry friction would feel its noise. Between
edges it is replaced by straight lines where long stretches of it are straight within the noise, and elsewhere by a
local parabola over the widest window that the noise permits (intersection of confidence intervals; Katkovnik 1999).
What error then remains is handed on to the whitening: the input stays a noisy one, only less so.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..rig.base import Channel, Measurement, RigConfig

_EDGE = 6.0  # a jump of so many standard deviations of a difference may be an edge
_LEVEL = 8  # samples of one slope that count as a stretch
_STRETCH = 200  # samples of a curve in which to look for two
_DRIFT = 1.0  # bound on max |cumulative residual| / (sigma sqrt n) of a straight stretch; its 1 % point
_WINDOWS = (2, 3, 5, 8, 12, 18, 27, 40, 60, 90)  # half widths of the local parabola, samples
_GAMMA = 1.0  # width of its confidence intervals; wider ones let bias pass that friction would feel


@dataclass(frozen=True, eq=False)
class InputSignal:
    """An input on the instants of a trace; linear in between, or held where `held`.

    Args:
        value: V or N m, shape (n,).
        error: standard deviation of what is left of the measurement noise, shape (n,).
        memory: correlation of that error from one instant to the next, shape (n,).
        edge: True for an interval in which the input jumps, at an instant nobody logged, shape (n - 1,).
        held: True for a duty, which an ECU holds from sample to sample.
    """

    value: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " n"]
    memory: Float[np.ndarray, " n"]
    edge: Bool[np.ndarray, " n-1"]
    held: bool = False


def _edges(value: Float[np.ndarray, " n"], sigma: float) -> Bool[np.ndarray, " n-1"]:
    """Intervals in which the input jumps: far above the noise and above what goes on around them."""
    jump = np.abs(np.diff(value))
    if jump.size < 3:
        return jump > _EDGE * np.sqrt(2.0) * sigma
    padded = np.pad(jump, 4, mode="reflect" if jump.size > 4 else "edge")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 9), axis=1)
    return (jump > _EDGE * np.sqrt(2.0) * sigma) & (jump > 4.0 * around)


def _parabola(value: Float[np.ndarray, " n"], sigma: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """A curved stretch: estimate and effective number of samples averaged, each of shape (n,)."""
    n = value.size
    index = np.arange(n, dtype=float)
    moments = [np.concatenate(([0.0], np.cumsum((value - value[0]) * (index - n / 2) ** k))) for k in range(3)]
    best, count = value.astype(float), np.ones(n)
    low, high = value - _GAMMA * sigma, value + _GAMMA * sigma
    growing = np.ones(n, dtype=bool)
    for half in _WINDOWS:
        reach = np.minimum(half, np.minimum(index, n - 1 - index)).astype(int)
        s0, s1, s2 = (m[np.arange(n) + reach + 1] - m[np.arange(n) - reach] for m in moments)
        centre = index - n / 2
        a, b = _savitzky_golay(reach)
        mean = value[0] + a * s0 + b * (s2 - 2.0 * centre * s1 + centre**2 * s0)
        spread = _GAMMA * sigma * np.sqrt(a)
        fits = reach >= 2
        low = np.where(fits, np.maximum(low, mean - spread), low)
        high = np.where(fits, np.minimum(high, mean + spread), high)
        growing &= (low <= high) & fits
        best, count = np.where(growing, mean, best), np.where(growing, 1.0 / a, count)
    return best, count


def _savitzky_golay(reach: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Weights a + b j^2, |j| <= reach, that give the centre of a parabola; a is also their variance."""
    width = 2.0 * reach + 1.0
    m2 = reach * (reach + 1.0) * width / 3.0
    m4 = m2 * (3.0 * reach**2 + 3.0 * reach - 1.0) / 5.0
    determinant = np.where(reach >= 2, width * m4 - m2**2, 1.0)
    return np.where(reach >= 2, m4 / determinant, 1.0), np.where(reach >= 2, -m2 / determinant, 0.0)


def _is_white(rest: Float[np.ndarray, " n"], sigma: float) -> bool:
    drift = np.max(np.abs(np.cumsum(rest))) / (sigma * np.sqrt(rest.size))
    return bool(drift < _DRIFT and rest.std() < 1.5 * sigma)


class _Stretch(NamedTuple):
    """An estimate of an edge-free stretch of n samples.

    Args:
        value: V or N m.
        variance: of its error, over sigma^2.
        shared: how many samples in a row have nearly one and the same error.
    """

    value: Float[np.ndarray, " n"]
    variance: Float[np.ndarray, " n"]
    shared: Float[np.ndarray, " n"]


def _stretch(value: Float[np.ndarray, " n"], sigma: float) -> _Stretch:
    """Estimate an edge-free stretch: by a line where it is straight within the noise, by parabolas elsewhere."""
    n = value.size
    if n >= _LEVEL:
        # also where it is level: a mean, taken wherever the slope is not seen, has a bias that its error does not state
        t = np.linspace(-1.0, 1.0, n)
        line = np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyfit(t, value, 1))
        if _is_white(value - line, sigma):
            return _Stretch(line, (1.0 + 3.0 * t**2) / n, np.full(n, float(n)))
    if n >= 2 * _STRETCH:
        at = _corner(value)
        left, right = _stretch(value[:at], sigma), _stretch(value[at:], sigma)
        return _Stretch(*(np.concatenate(pair) for pair in zip(left, right, strict=True)))
    estimate, count = _parabola(value, sigma)
    # what the choice of windows adds, measured on multisines, chirps and trapezoids (test_input_signal.py)
    return _Stretch(estimate, np.where(count > 1.0, 1.6, 1.0) / count, np.maximum(1.0, count / 1.5))


def _corner(value: Float[np.ndarray, " n"]) -> int:
    """Where a stretch that is not straight departs most from its chord, away from its ends."""
    n = value.size
    width = max(1, n // 50)
    smooth = np.convolve(value, np.ones(width) / width, mode="valid")
    chord = np.linspace(smooth[0], smooth[-1], smooth.size)
    return int(np.clip(np.argmax(np.abs(smooth - chord)) + width // 2, _STRETCH // 2, n - _STRETCH // 2))


def denoise(value: Float[np.ndarray, " n"], sigma: float) -> InputSignal:
    """Average between edges; see the module's head.

    Args:
        value: logged input, shape (n,).
        sigma: standard deviation of its noise.
    """
    edge = _edges(value, sigma)
    bounds = np.concatenate(([0], np.flatnonzero(edge) + 1, [value.size]))
    parts = [_stretch(value[a:b], sigma) for a, b in pairwise(bounds)]
    estimate, variance, count = (np.concatenate(column) for column in zip(*parts, strict=True))
    memory = np.where(count > 1.0, np.exp(-2.0 / np.maximum(count, 1.0)), 0.0)
    return InputSignal(estimate, sigma * np.sqrt(variance), memory, edge)


def _on(instants: Float[np.ndarray, " n"], channel: Channel) -> Float[np.ndarray, " n"]:
    return np.interp(instants, channel.time, channel.value)


def _duty(measurement: Measurement, config: RigConfig, instants: Float[np.ndarray, " n"]) -> InputSignal:
    duty = measurement.channels["duty"]
    supply = measurement.channels.get("supply")
    level = _on(instants, supply) if supply is not None else np.full(instants.size, config.supply_V)
    latest = np.clip(np.searchsorted(duty.time, instants, side="right") - 1, 0, None)
    zero = np.zeros(instants.size)
    return InputSignal(duty.value[latest] * level, zero, zero, zero[1:] > 0.0, held=True)


def commanded(instants: Float[np.ndarray, " n"], supply: float) -> InputSignal:
    """What an ECU that is part of the model adds its terms to: what its integral held where the trace began.

    It is one number for the whole trace, which nobody logged: 0 until the model has seen it, and as uncertain as a
    quarter of the supply.
    """
    level, error = np.zeros(instants.size), np.full(instants.size, 0.25 * supply)
    return InputSignal(level, error, np.ones(instants.size), np.zeros(instants.size - 1, dtype=bool))


def input_of(measurement: Measurement, config: RigConfig, instants: Float[np.ndarray, " n"]) -> InputSignal | None:
    """The input of a trace: voltage, or duty times supply, or torque; None where it has none.

    Args:
        measurement: the trace.
        config: its rig.
        instants: s, shape (n,).
    """
    for name in ("voltage", "torque"):
        if name in measurement.channels:
            channel = measurement.channels[name]
            return denoise(_on(instants, channel), channel.sigma)
    if "duty" in measurement.channels and ("supply" in measurement.channels or config.supply_V):
        return _duty(measurement, config, instants)
    return None
