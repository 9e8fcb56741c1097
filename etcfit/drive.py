"""What drove the plate: the logged input, freed of its measurement noise as far as the log itself allows.

The logged voltage is a measurement of the true input, and the model's dry friction would feel its noise. Between
edges it is averaged over the widest window that the noise still permits at each sample (intersection of confidence
intervals; Katkovnik 1999), and what error then remains is handed on to the whitening as a noisy input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rig.base import Channel, Measurement, RigConfig

_WINDOWS = (0, 1, 2, 4, 7, 12, 20, 33, 54, 90)  # half widths, samples
_GAMMA = 2.0  # width of the confidence intervals, in standard deviations
_EDGE = 6.0  # a jump of so many standard deviations of a difference may be an edge


@dataclass(frozen=True, eq=False)
class Drive:
    """An input on the instants of a trace; linear in between, or held where `held`.

    Args:
        value: V or N m, shape (n,).
        error: standard deviation of what is left of the measurement noise, shape (n,).
        memory: correlation of that error from one instant to the next, shape (n,).
        edge: uncertainty of the mean over each interval because nobody knows when within it an edge came, (n - 1,).
        held: True for a duty, which an ECU holds from sample to sample.
    """

    value: np.ndarray
    error: np.ndarray
    memory: np.ndarray
    edge: np.ndarray
    held: bool = False


def _edges(value: np.ndarray, sigma: float) -> np.ndarray:
    """Intervals in which the input jumps: far above the noise and above what goes on around them."""
    jump = np.abs(np.diff(value))
    if jump.size < 3:
        return jump > _EDGE * np.sqrt(2.0) * sigma
    padded = np.pad(jump, 4, mode="reflect" if jump.size > 4 else "edge")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 9), axis=1)
    return (jump > _EDGE * np.sqrt(2.0) * sigma) & (jump > 4.0 * around)


def _smooth(value: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """One stretch without edges: estimate and number of samples averaged, each of shape (n,)."""
    n = value.size
    index = np.arange(n)
    total = np.concatenate(([0.0], np.cumsum(value - value[0])))
    best, count = value.copy(), np.ones(n)
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    open_ = np.ones(n, dtype=bool)
    for half in _WINDOWS:
        reach = np.minimum(half, np.minimum(index, n - 1 - index))  # symmetric, so that a ramp stays a ramp
        width = 2 * reach + 1
        mean = value[0] + (total[index + reach + 1] - total[index - reach]) / width
        spread = _GAMMA * sigma / np.sqrt(width)
        low, high = np.maximum(low, mean - spread), np.minimum(high, mean + spread)
        open_ &= low <= high
        best, count = np.where(open_, mean, best), np.where(open_, width, count)
    return best, count


def _constant(value: np.ndarray, sigma: float) -> bool:
    """True where a whole stretch is one level within its noise."""
    if value.size < 8:
        return False
    thirds = np.array([part.mean() for part in np.array_split(value, 3)])
    return bool(np.ptp(thirds) < 3.5 * sigma / np.sqrt(value.size / 3.0) and value.std() < 1.5 * sigma)


def denoise(value: np.ndarray, sigma: float) -> Drive:
    """Average between edges; see the module's head.

    Args:
        value: logged input, shape (n,).
        sigma: standard deviation of its noise.
    """
    edge = _edges(value, sigma)
    bounds = np.concatenate(([0], np.flatnonzero(edge) + 1, [value.size]))
    estimate, count = value.astype(float).copy(), np.ones(value.size)
    for start, stop in zip(bounds[:-1], bounds[1:], strict=True):
        part = value[start:stop]
        if _constant(part, sigma):
            estimate[start:stop], count[start:stop] = part.mean(), part.size
        else:
            estimate[start:stop], count[start:stop] = _smooth(part, sigma)
    jump = np.where(edge, np.abs(np.diff(estimate)) / np.sqrt(12.0), 0.0)
    return Drive(estimate, sigma / np.sqrt(count), np.exp(-2.0 / count) * (count > 1), jump)


def _on(instants: np.ndarray, channel: Channel) -> np.ndarray:
    return np.interp(instants, channel.time, channel.value)


def _duty(measurement: Measurement, config: RigConfig, instants: np.ndarray) -> Drive:
    duty = measurement.channels["duty"]
    supply = measurement.channels.get("supply")
    level = _on(instants, supply) if supply is not None else np.full(instants.size, config.supply_V)
    latest = np.clip(np.searchsorted(duty.time, instants, side="right") - 1, 0, None)
    zero = np.zeros(instants.size)
    return Drive(duty.value[latest] * level, zero, zero, zero[1:], held=True)


def drive_of(measurement: Measurement, config: RigConfig, instants: np.ndarray) -> Drive | None:
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
