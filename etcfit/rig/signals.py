"""Functions that the graph readings share: robust lines, steps and plateaus, slow derivatives, the moving part of a
trace."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .base import Channel, Measurement, RigConfig
from .smoothing import slope, smoothed

BISQUARE = 4.685  # 95 % efficient on Gaussian noise (Tukey)
MAD_TO_SIGMA = 1.4826
FEWEST = 7  # least number of samples of a motion
MOST_FILLED = 20  # most samples of an even grid over the logged ones: a log with a long gap must not fill the memory
WAY_63 = float(1 - np.exp(-1))


@dataclass(frozen=True)
class Line:
    """y = slope x + offset."""

    slope: float
    offset: float

    def at(self, x: np.ndarray) -> np.ndarray:
        return self.slope * x + self.offset


@dataclass(frozen=True, eq=False)
class Plateau:
    """A stretch with a constant drive; its settled samples are the last part of it."""

    start: float
    stop: float

    def settled(self, channel: Channel, part: float = 0.4) -> float:
        """Mean of the channel over the last `part` of the plateau; NaN where it was not logged there."""
        inside = (channel.time >= self.stop - part * (self.stop - self.start)) & (channel.time <= self.stop)
        return float(np.mean(channel.value[inside])) if inside.any() else float("nan")


@dataclass(frozen=True, eq=False)
class Motion:
    """Plate motion on an even grid: s, rad, rad/s; `smooth` filters any other channel in the same way as the speed."""

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    step: float
    window: int

    def smooth(self, channel: Channel) -> np.ndarray:
        return smoothed(on_times(channel, self.time), self.window)


def robust_fit(columns: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares with Tukey's bisquare weights: argmin_c sum rho((y - X c)/s), s from the median deviation."""
    weights = np.ones(len(y))
    coefficients = np.zeros(columns.shape[1])
    for _ in range(20):
        root = np.sqrt(weights)
        coefficients = np.linalg.lstsq(columns * root[:, None], y * root, rcond=None)[0]
        residual = y - columns @ coefficients
        spread = MAD_TO_SIGMA * np.median(np.abs(residual))
        if spread <= 1e-12 * np.max(np.abs(y), initial=1e-300):
            break
        weights = np.maximum(1 - (residual / (BISQUARE * spread)) ** 2, 0.0) ** 2
    return coefficients


def robust_line(x: np.ndarray, y: np.ndarray) -> Line:
    """Straight line with an offset; through the origin for fewer than three points."""
    if len(x) < 3:
        return Line(robust_slope(x, y), 0.0)
    slope, offset = robust_fit(np.column_stack([x, np.ones_like(x)]), y)
    return Line(float(slope), float(offset))


def robust_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the straight line through the origin."""
    return float(robust_fit(x[:, None], y)[0])


def on_times(channel: Channel, time: np.ndarray) -> np.ndarray:
    """The channel, linearly interpolated on other times."""
    return np.interp(time, channel.time, channel.value)


def drive_voltage(trace: Measurement, config: RigConfig) -> Channel | None:
    """v_a = voltage, or duty x supply (column or rig.toml); None where neither was logged."""
    if "voltage" in trace.channels:
        return trace.channels["voltage"]
    duty, supply = trace.channels.get("duty"), trace.channels.get("supply")
    if duty is None or (supply is None and config.supply_V is None):
        return None
    volts = config.supply_V if supply is None else on_times(supply, duty.time)
    sigma = duty.sigma * float(np.mean(np.asarray(volts)))
    return Channel(duty.time, duty.value * volts, sigma, duty.sigma_estimated, duty.header, "V", 1.0)


def jumps(channel: Channel, noises: float, share: float) -> np.ndarray:
    """True where two samples differ by more than `noises` standard deviations of the noise and `share` of the span,
    shape (n - 1,)."""
    return np.abs(np.diff(channel.value)) > max(noises * channel.sigma, share * float(np.ptp(channel.value)))


def plateaus(channel: Channel, least: float = 0.02) -> list[Plateau]:
    """Stretches between jumps of the channel, each longer than the part `least` of the trace.

    A jump is a sample-to-sample change above 6 sigma of such changes and above 2 % of the channel's span.
    """
    if len(channel.time) < 2:
        return []
    jumps = np.abs(np.diff(channel.value))
    noise = MAD_TO_SIGMA * float(np.median(jumps))
    level = max(6 * noise, 9 * channel.sigma, 0.02 * float(np.ptp(channel.value)), 1e-12)
    edges = np.flatnonzero(jumps > level)
    starts = np.r_[channel.time[0], channel.time[edges + 1]]
    stops = np.r_[channel.time[edges], channel.time[-1]]
    shortest = least * (channel.time[-1] - channel.time[0])
    return [Plateau(float(a), float(b)) for a, b in zip(starts, stops, strict=True) if b - a > shortest]


def settled_points(logged: Iterable[tuple[Channel | None, Channel | None, Channel | None]]) -> np.ndarray:
    """Settled values of two channels at every plateau of a drive at which both were logged, SI, shape (n, 2).

    Args:
        logged: the drive and both channels of each trace.
    """
    there = [(d, x, y) for d, x, y in logged if d is not None and x is not None and y is not None]
    points = np.array([(p.settled(x), p.settled(y)) for d, x, y in there for p in plateaus(d)]).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def rise_time(channel: Channel, start: float, first: float, last: float, stop: float) -> float:
    """t_63 from `start`: time until the channel has moved 1 - 1/e of its way from level `first` to level `last`.

    An exponential makes ln(1 - y) = -(t - t_0)/tau; a line through the samples between 35 and 85 % of the way
    averages their noise and its crossing of -1 is the 63 % instant. With fewer than three such samples: interpolation.
    """
    inside = (channel.time >= start) & (channel.time <= stop)
    time, way = channel.time[inside], (channel.value[inside] - first) / (last - first)
    if len(way) < 2 or way.max() < 0.64:
        return float("nan")
    past = int(np.argmax(way > 0.85)) if (way > 0.85).any() else len(way)
    band = np.flatnonzero((way[:past] > 0.35) & (way[:past] < 0.85))
    if len(band) >= 3:
        line = robust_line(np.log(1 - way[band]), time[band])
        return float(line.at(np.array(-1.0)) - start)
    above = int(np.argmax(way > WAY_63))
    if above == 0:
        return float("nan")
    around = slice(above - 1, above + 1)
    return float(np.interp(WAY_63, way[around], time[around]) - start)


def mean_delay(channel: Channel, start: float, first: float, last: float, stop: float) -> float:
    """Area between a step and its response over the step: integral (1 - y) dt, s; for tau alone it is t_63.

    For a chain of lags, oscillating or not, it is the sum of their time constants; t_63 is not. The tail beyond ten 63
    % times is left out, because it only adds noise.
    """
    rise = rise_time(channel, start, first, last, stop)
    inside = (channel.time >= start) & (channel.time <= min(stop, start + 10 * rise))
    if not inside.any():
        return float("nan")
    time = np.r_[start, channel.time[inside]]
    left = np.r_[1.0, 1 - (channel.value[inside] - first) / (last - first)]
    return float(np.trapezoid(left, time))


def even_grid(time: np.ndarray) -> tuple[np.ndarray, float]:
    """Even times over the same span, and their step: the median of the logged steps, s."""
    count = round(float((time[-1] - time[0]) / np.median(np.diff(time))))
    count = min(max(count, 1), MOST_FILLED * len(time))
    return np.linspace(time[0], time[-1], count + 1), float((time[-1] - time[0]) / count)


def in_gap(logged: np.ndarray, time: np.ndarray, step: float) -> np.ndarray:
    """True at times without a near sample: in a gap of more than five steps, or beyond the ends."""
    after = np.searchsorted(logged, time)
    ends = np.r_[-np.inf, logged, np.inf]
    return (ends[after + 1] - ends[after] > 5.0 * step) & (ends[after + 1] > time)


def motion(position: Channel, window: float) -> Motion | None:
    """Angle and speed by local parabolas (Savitzky, Golay 1964) over `window` s; None for too short a trace."""
    if len(position.time) < FEWEST:
        return None
    time, step = even_grid(position.time)
    samples = min(max(2 * round(window / step / 2) + 1, 5), len(time) - (len(time) + 1) % 2)
    angle = on_times(position, time)
    return Motion(time, smoothed(angle, samples), slope(angle, samples, step), step, samples)


def smoothing_window(position: Channel) -> float:
    """Duration (s) over which a slope of the position is known to 5 % of its mean speed in motion.

    sigma_slope = sqrt(12 dt / W^3) sigma for W seconds of samples dt apart.
    """
    if len(position.time) < FEWEST:
        return 0.0
    travel, step = float(np.ptp(position.value)), float(np.median(np.diff(position.time)))
    # the time of one travel, s: twice the shortest in which the position crosses the middle half of its span
    low, high = np.quantile(position.value, [0.0, 1.0])
    below = position.value < low + 0.25 * (high - low)
    above = position.value > low + 0.75 * (high - low)
    side = np.where(below, -1, np.where(above, 1, 0))
    ends = np.flatnonzero(side)
    turns = ends[1:][np.diff(side[ends]) != 0]
    steepest = float(position.time[-1] - position.time[0])
    if len(turns):
        before = ends[np.searchsorted(ends, turns) - 1]
        steepest = 2 * float(np.min(position.time[turns] - position.time[before]))
    noise = position.error
    speed = travel / max(steepest, step)
    wanted = (12 * step * (noise / max(0.05 * speed, 1e-12)) ** 2) ** (1 / 3)
    return float(np.clip(wanted, 5 * step, max(0.3 * steepest, 5 * step)))


def off_stops(angle: np.ndarray, config: RigConfig, sigma: float) -> np.ndarray:
    """True where the plate is away from both end stops, by 5 sigma and by 2 % of the travel."""
    low, high = config.travel
    if not np.isfinite(high - low):
        return (angle > low) & (angle < high)
    margin = max(5 * sigma, 0.02 * (high - low))
    return (angle > low + margin) & (angle < high - margin)


def widened(mask: np.ndarray, samples: int) -> np.ndarray:
    """The mask, extended by `samples` on either side of each stretch of True."""
    reach = np.convolve(mask.astype(float), np.ones(2 * samples + 1), mode="full")
    return reach[samples : samples + len(mask)] > 0.5


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
