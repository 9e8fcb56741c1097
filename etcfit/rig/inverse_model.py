"""The inverse-model reading of a driven plate: torque regressed on the resulting motion.

    torque = J a + B w + K_s theta + T_PL + T_f sgn(w) + T_g sin(theta)

Source: Gautier's IDIM-LS as in Janot, Gautier, Brunot 2019 (EMPS): the position filtered without phase, differentiated
centrally, both sides of the equation decimated by the same filter. Differs from source: samples on the end stops and at
rest are left out, and the bandwidth is lowered where position noise would dominate the acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .base import Channel, Measurement, RigConfig
from .signals import even_grid, in_gap, off_stops, on_times, widened
from .smoothing import butterworth, chebyshev

LUMPED = ("J_eq", "B_eq", "K_s", "T_PL", "T_f", "T_g")
BANDWIDTHS = (20.0, 14.0, 10.0, 7.0, 5.0)  # Hz; the first is that of the published EMPS figures
LARGEST_NOISE = 0.4  # largest share of noise in the rms of the acceleration
LONGEST_PAD = 50  # samples that the filters reflect at each end, and some more
AT_REST = 0.01  # share of the top speed below which the plate counts as at rest


@dataclass(frozen=True)
class Filter:
    """Zero-phase filters for a bandwidth (Hz): position below 5 times it, both sides of the equation below 2 times
    it."""

    bandwidth: float
    rate: float

    @property
    def cutoff(self) -> float:
        """Cutoff of the position's Butterworth filter of fourth order, Hz."""
        return min(5 * self.bandwidth, 0.4 * self.rate)

    @property
    def ratio(self) -> int:
        """Decimation."""
        return max(1, round(0.2 * self.rate / self.bandwidth))

    @property
    def span(self) -> int:
        """Samples over which the filters look: 1/bandwidth."""
        return max(1, round(self.rate / self.bandwidth))

    def position(self, angle: np.ndarray) -> np.ndarray:
        return butterworth(4, 2 * self.cutoff / self.rate)(angle)

    def below(self, rows: np.ndarray) -> np.ndarray:
        """The rows filtered by Chebyshev, eighth order, 0.05 dB, as in the source; unfiltered without decimation."""
        return rows if self.ratio == 1 else chebyshev(8, 0.05, 0.8 / self.ratio)(rows)

    def decimated(self, rows: np.ndarray) -> np.ndarray:
        """Every ratio-th filtered row."""
        return self.below(rows)[:: self.ratio]

    def __str__(self) -> str:
        below = f"decimated by {self.ratio}" if self.ratio > 1 else "not decimated"
        return f"position below {self.cutoff:.3g} Hz (Butterworth 4, zero phase), both sides {below}"


@dataclass(frozen=True, eq=False)
class Equations:
    """Rows of `LUMPED` regressors and their right-hand side: torque (N m), or volts, at `time` (s)."""

    time: np.ndarray
    rows: np.ndarray
    right: np.ndarray

    def scaled(self, factor: float) -> Equations:
        """Equations with the right-hand side times a factor."""
        return Equations(self.time, self.rows, factor * self.right)

    def error(self, lumped: Sequence[float] | np.ndarray) -> float:
        """|right - rows lumped| / |right|."""
        return float(np.linalg.norm(self.right - self.rows @ np.asarray(lumped)) / np.linalg.norm(self.right))


def equations(trace: Measurement, right: Channel, config: RigConfig | None = None) -> Equations:
    """Filtered regressors and right-hand side of a trace; with a rig, without rest and stops."""
    position = trace.channels["position"]
    time, step = even_grid(position.time)
    angle = on_times(position, time)
    chosen = filter_for(position)
    if len(time) < 2 * chosen.span + LONGEST_PAD:
        return Equations(np.empty(0), np.empty((0, len(LUMPED))), np.empty(0))
    smooth = chosen.position(angle)
    speed = np.gradient(smooth, step)
    columns = [np.gradient(speed, step), speed, smooth, np.ones_like(speed), np.sign(speed), np.sin(smooth)]
    columns.append(on_times(right, time))
    inside = slice(chosen.span, len(time) - chosen.span)  # the filters' borders
    rows = chosen.decimated(np.column_stack(columns)[inside])
    keep = ~widened(in_gap(position.time, time, step) | in_gap(right.time, time, step), chosen.span // 2)
    if config is not None:
        keep &= moving(smooth, speed, chosen, config, position.sigma)
    used = keep[inside][:: chosen.ratio]
    return Equations(time[inside][:: chosen.ratio][used], rows[used, :-1], rows[used, -1])


def moving(angle: np.ndarray, speed: np.ndarray, chosen: Filter, config: RigConfig, sigma: float) -> np.ndarray:
    """True off the stops (by half a filter span) and not at rest for a span, because friction at rest is unknown."""
    on_stop = widened(~off_stops(angle, config, sigma), chosen.span // 2)
    noise = 3 * sigma * 2 * np.pi * chosen.cutoff * np.sqrt(2 * chosen.cutoff / chosen.rate)
    slow = np.abs(speed) < max(AT_REST * float(np.max(np.abs(speed))), noise)
    half = chosen.span // 2
    resting = widened(~widened(~slow, half), half)
    return ~on_stop & ~resting


def filter_for(position: Channel) -> Filter:
    """The widest bandwidth at which position noise is less than `LARGEST_NOISE` of the acceleration."""
    time, step = even_grid(position.time)
    angle, noise = on_times(position, time), position.error
    chosen = [Filter(bandwidth, 1 / step) for bandwidth in BANDWIDTHS if 4 / bandwidth < time[-1] - time[0]]
    pulse = np.zeros(len(time))
    pulse[len(time) // 2] = noise
    for candidate in chosen:
        smooth = (candidate.position(x) for x in (angle, pulse))
        seen, made = (np.std(candidate.below(np.gradient(np.gradient(x, step), step))) for x in smooth)
        if made * np.sqrt(len(time)) < LARGEST_NOISE * seen:
            return candidate
    return chosen[-1] if chosen else Filter(BANDWIDTHS[0], 1 / step)


def solve(systems: Sequence[Equations], held: Mapping[str, float]) -> np.ndarray:
    """Least squares for `LUMPED`; terms with held values are moved to the other side."""
    rows, right = np.concatenate([s.rows for s in systems]), np.concatenate([s.right for s in systems])
    lumped = np.array([held.get(symbol, 0.0) for symbol in LUMPED])
    free = np.array([symbol not in held for symbol in LUMPED])
    scale = np.linalg.norm(rows[:, free], axis=0) + 1e-300
    lumped[free] = np.linalg.lstsq(rows[:, free] / scale, right - rows @ lumped, rcond=1e-10)[0] / scale
    return lumped


def held_values(config: RigConfig, N: float) -> dict[str, float]:
    """Values of `LUMPED` that rig.toml fixes: J_eq and B_eq only where both their parts are fixed; T_g is 0 without
    gravity."""
    fixed = config.fixed
    held = {symbol: fixed[symbol] for symbol in ("K_s", "T_PL", "T_f", "T_g") if symbol in fixed}
    if "gravity_load" not in config.effects:
        held["T_g"] = 0.0
    for whole, motor, load in (("J_eq", "J_m", "J_L"), ("B_eq", "B_m", "B_L")):
        if motor in fixed and load in fixed:
            held[whole] = N**2 * fixed[motor] + fixed[load]
    return held
