"""Finds an oscillation of the plate while its setpoint rests: its amplitude, period, cause and cure.

Stick-slip: the plate stands still for most of the period while the integral winds up, then jumps. Instability: the
plate moves all the time, almost as a sine, because the gains are too high. The two are distinguished by the share of
the time in which the plate is nearly still: 0.16 for a sine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .log import Series
from .steps import Rest, log_resolution, noise_sd, rests

Kind = Literal["stick-slip", "instability", "unknown"]

_SETTLES = 0.5  # s of a rest in which the plate may still answer a step
_SHORTEST = 0.8  # s: least length of a rest that is evaluated
_REPEATS = 0.5  # least autocorrelation one period later
_AS_TALL = 0.85  # of the highest peak of the autocorrelation: the first such peak is the period, not a multiple of it
_PERIODS = 2.5  # least number of periods in a rest
_SHAPE_SEEN = 6.0  # standard deviations of the sensor's noise: the shape of a smaller motion cannot be seen
_SMOOTH = 20.0  # samples a period at which second differences show the noise alone
_SLOW = 0.25  # of the highest speed: a slower plate counts as still
_STILL = 0.38  # share of the time at which the plate is still, above which the oscillation is stick-slip
_SAMPLES = 4.0  # samples a period that are needed to see the shape
_DECAYS = 0.5  # last swing over first: a smaller ratio is the end of a step response
_LATER = 0.0, 0.25, 0.5, 0.75  # shares of a rest that are skipped, in this order, until an oscillation is seen
_DITHER = 50.0  # Hz: fast compared with the loop; assumed
_MARGIN = 1.2  # factor of the dead zone over the largest error, and of dither over the friction


@dataclass(frozen=True)
class LimitCycle:
    """An oscillation while the setpoint rests."""

    amplitude: float  # half of the peak-to-peak motion, per cent of travel; median over the rests with an oscillation
    period: float  # s
    share: float  # share of the time at rest in which the plate oscillates, 0 to 1, after the end of the step response
    kind: Kind  # "stick-slip", "instability", or "unknown" where the log is too slow or too coarse to tell
    still: float  # share of the period in which the plate is nearly still; 0.16 for a sine
    where: tuple[float, float]  # setpoints with an oscillation, least and largest, per cent
    duty: float | None  # half of the peak-to-peak duty, per cent; None where none was logged
    # |error| below which the integral must stand still to stop stick-slip, per cent of travel; else None
    dead_zone: float | None
    # amplitude of a fast alternating duty that would stop stick-slip, per cent; None where dither does not help or no
    # duty was logged
    dither: float | None

    @property
    def says(self) -> str:
        """Kind and cure of the oscillation in sentences."""
        what = {"stick-slip": "This is stick-slip: dry friction holds the plate while the integral winds up.",
                "instability": "This is instability: the gains are too high.",
                "unknown": "The log is too slow or too coarse to tell stick-slip from instability: log at "
                           f"{20.0 / self.period:.0f} Hz or more, with a finer resolution."}[self.kind]  # fmt: skip
        low, high = self.where
        place = f"at {low:.0f} %" if high - low < 1.0 else f"between {low:.0f} and {high:.0f} %"
        head = (f"At rest the plate oscillates by +-{self.amplitude:.2g} % of travel, {self.period:.2g} s a period, "
                f"in {100.0 * self.share:.0f} % of the time at rest ({place}).")  # fmt: skip
        return f"{head} {what} {self._cure}".rstrip()

    @property
    def _cure(self) -> str:
        if self.kind == "instability":
            return ("Lower P and D first, both by a third (half of the P at which P alone oscillates is usual: Ziegler "
                    "and Nichols 1942); a dead zone or dither does not cure it.")  # fmt: skip
        if self.kind == "unknown" or self.dead_zone is None:
            return ""
        other = "" if self.dither is None else (
            f" or dither of +-{self.dither:.2g} % of duty at {_DITHER:g} Hz or faster,"
        )  # fmt: skip
        return (f"To stop it: a dead zone of {self.dead_zone:.2g} % of travel in which the integral stops,"
                f"{other} or less I (Armstrong-Helouvry, Dupont and Canudas de Wit 1994).")  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Held:
    """The result of one rest: an oscillation where `period` is not None."""

    # looked, seconds: time that was evaluated, and time in which the plate oscillates, s
    looked: float
    seconds: float
    level: float
    amplitude: float
    period: float | None
    still: float
    duty: float | None
    off: float


def limit_cycle(position: Series, setpoint: Series, duty: Series | None = None) -> LimitCycle | None:
    """The oscillation at rest; None where there is none.

    A rest counts from 0.5 s after its begin. The plate oscillates in it where its autocorrelation returns to 0.5 one
    period later, the motion is larger than noise and it does not decay. The response to a large step may last longer
    than 0.5 s and hide an oscillation: where none is seen, the last 3/4, 1/2 and 1/4 of the rest are evaluated. The
    cures are for stick-slip alone:

        dead zone = 1.2 max |error| at rest,    dither = 1.2 (half of the peak-to-peak duty in a period)

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), for the cures. Differs from source:
    thresholds are ours, tuned on simulated logs (`benchmarks/good_enough.py`).
    """
    quantum, step = log_resolution(position.value), position.step
    looked = [each for piece in setpoint.pieces if piece.time.size > 1 for rest in rests(piece)
              if (each := _held(position, step, rest, duty, quantum)) is not None]  # fmt: skip
    cycling = [each for each in looked if each.period is not None]
    if not cycling:
        return None
    return _together(cycling, sum(each.looked for each in looked), position, quantum)


def at_rest(position: Series, setpoint: Series) -> float:
    """Time at rest in which an oscillation would be visible, s."""
    found = (rest for piece in setpoint.pieces if piece.time.size > 1 for rest in rests(piece))
    spans = (min(rest.end, float(position.time[-1])) - rest.begin - _SETTLES for rest in found)
    return sum(span for span in spans if span >= _SHORTEST)


def _together(cycling: Sequence[_Held], seconds: float, position: Series, quantum: float) -> LimitCycle:
    weight = np.array([each.seconds for each in cycling])

    def middle(values: Sequence[float]) -> float:
        order = np.argsort(values)
        return float(np.asarray(values)[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())])

    amplitude, still = middle([c.amplitude for c in cycling]), middle([c.still for c in cycling])
    period = middle([c.period for c in cycling if c.period is not None])
    duties = [c.duty for c in cycling if c.duty is not None]
    width = max(0.05 * period / position.step, 1.0)  # samples that are averaged
    sd = noise_sd(position.value) / np.sqrt(width) if period > _SMOOTH * position.step else 0.0
    coarse = amplitude < max(_SHAPE_SEEN * sd, 2.0 * quantum) or period < _SAMPLES * position.step
    kind: Kind = "unknown" if coarse else "stick-slip" if still > _STILL else "instability"
    swing = float(np.median(duties)) if duties else None
    sticks = kind == "stick-slip"
    return LimitCycle(
        amplitude, period, float(weight.sum() / seconds), kind, still,
        (min(c.level for c in cycling), max(c.level for c in cycling)), swing,
        _MARGIN * max(c.off for c in cycling) if sticks else None,
        _MARGIN * swing if sticks and swing is not None else None,
    )  # fmt: skip


def _held(position: Series, step: float, rest: Rest, duty: Series | None, quantum: float) -> _Held | None:
    begin, end = max(rest.begin + _SETTLES, float(position.time[0])), min(rest.end, float(position.time[-1]))
    if end - begin < _SHORTEST:
        return None
    looked, level = float(end - begin), 0.5 * (rest.first + rest.last)
    for later in (begin + share * looked for share in _LATER):
        if (found := _swinging(position, step, (later, end), quantum)) is not None:
            amplitude, period, still, value = found
            off = float(np.quantile(np.abs(value - level), 0.98))
            swing = _of_duty(duty, later, end, period)
            return _Held(looked, float(end - later), level, amplitude, period, still, swing, off)
    return _Held(looked, 0.0, level, 0.0, None, 0.0, None, 0.0)


def _swinging(
    position: Series, step: float, span: tuple[float, float], quantum: float
) -> tuple[float, float, float, np.ndarray] | None:
    """Amplitude, period (s), share of it in which the plate is nearly still, and the position; None where the plate
    does not keep oscillating."""
    begin, end = span
    time = np.arange(begin, end, step)
    value = np.interp(time, position.time, position.value)
    if time.size < 8:
        return None
    moved = value - np.polyval(np.polyfit(time - begin, value, 1), time - begin)
    if np.ptp(moved) < max(2.0 * quantum, 1e-9):
        return None
    period = _period(moved, step)
    if period is None or end - begin < max(_PERIODS * period, _SHORTEST):
        return None
    smooth = _smoothed(moved, period, step)
    swings = _swings(smooth, period, step)
    if swings[-1] < _DECAYS * swings[0] or np.median(swings) < quantum:
        return None
    # share of the time in which the plate is slower than a quarter of its highest speed
    width = max(round(0.1 * period / step), 1)
    way = np.abs(smooth[width:] - smooth[:-width])
    still = float(np.mean(way < _SLOW * np.quantile(way, 0.98)))
    return float(np.median(swings)), period, still, value


def _period(moved: np.ndarray, step: float) -> float | None:
    """The delay at which the autocorrelation is highest after it has first fallen below 0, s; None where it stays below
    0.5."""
    n = moved.size
    spectrum = np.fft.rfft(moved, 2 * n)
    lags = np.fft.irfft(np.abs(spectrum) ** 2)[: int(n / _PERIODS) + 2]
    lags = lags / np.arange(n, n - lags.size, -1)
    lags = lags / max(lags[0], 1e-300)
    below = np.flatnonzero(lags < 0.0)
    if not below.size:
        return None
    after = lags[below[0] :]
    inside = np.flatnonzero((after[1:-1] >= after[:-2]) & (after[1:-1] >= after[2:])) + 1
    tall = [k for k in inside if after[k] >= _REPEATS]
    if not tall:
        return None
    most = max(after[k] for k in tall)
    first = next(k for k in tall if after[k] >= _AS_TALL * most) + below[0]
    left, top, right = lags[first - 1 : first + 2]
    bend = left - 2.0 * top + right
    period = first + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)
    # with few samples a period, a multiple of the period may correlate better: the strongest tone tells which multiple
    power = np.abs(spectrum) ** 2
    return float(step * period / max(round(period * int(np.argmax(power)) / (2 * n)), 1))


def _smoothed(moved: np.ndarray, period: float, step: float) -> np.ndarray:
    """A moving mean over a twentieth of the period."""
    width = max(round(0.05 * period / step), 1)
    return np.convolve(moved, np.ones(width) / width, "valid")


def _swings(moved: np.ndarray, period: float, step: float) -> np.ndarray:
    """Half of the peak-to-peak motion in each period, in order."""
    width = max(round(period / step), 2)
    parts = [moved[k : k + width + 1] for k in range(0, max(moved.size - width, 1), width)]
    return np.array([0.5 * np.ptp(part) for part in parts])


def _of_duty(duty: Series | None, begin: float, end: float, period: float) -> float | None:
    if duty is None:
        return None
    seen = (duty.time >= begin) & (duty.time <= end)
    if seen.sum() < 8:
        return None
    swings = _swings(_smoothed(duty.value[seen], period, duty.step), period, duty.step)
    return float(np.median(swings))
