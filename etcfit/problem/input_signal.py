"""The input of the plate: the logged input with its measurement noise reduced as far as the log allows.

The logged voltage is a measurement of the true input, and its noise would act on the model's dry friction. Between
edges it is replaced by straight lines where long stretches are straight within the noise, and elsewhere by a local
parabola over the widest window that the noise permits (intersection of confidence intervals; Katkovnik 1999). The
whitening includes the remaining error: the input is still noisy, but less so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..model.rig_effects import EdgePhase, Place
from ..rig.base import Channel, Measurement, RigConfig

_EDGE = 6.0  # a jump of so many standard deviations of a difference may be an edge
_LEVEL = 8  # samples of one slope that count as a stretch
_FEW = 64  # one sample in so many is enough to show that a long stretch is clearly curved
_STRETCH = 200  # samples of a curve above which it may be two stretches
_DRIFT = 1.0  # bound on max |cumulative residual| / (sigma sqrt n) of a straight stretch; its 1 % point
_WINDOWS = (2, 3, 5, 8, 12, 18, 27, 40, 60, 90)  # half widths of the local parabola, samples
_AT_ONCE = 8192  # samples of curves that are computed together
_GAMMA = 1.0  # width of its confidence intervals; wider ones would permit a bias that acts on friction


@dataclass(frozen=True, eq=False)
class InputSignal:
    """The input of a trace at its instants; linear in between, or constant where `held`."""

    value: Float[np.ndarray, " n"]  # V, or N m for a torque, shape (n,)
    # standard deviation of the remaining measurement noise, unit of the value, shape (n,)
    error: Float[np.ndarray, " n"]
    memory: Float[np.ndarray, " n"]  # correlation of that error from one instant to the next, 0 to 1, shape (n,)
    # True for an interval in which the input jumps, at an instant that was not logged, shape (n - 1,)
    edge: Bool[np.ndarray, " n-1"]
    held: bool = False  # True for a duty, which an ECU holds from sample to sample
    # turns of edges in step with the samples, see `Measurement.edge_turn`, shape (n - 1,); NaN elsewhere. None if there
    # are none.
    turn: Float[np.ndarray, " n-1"] | None = None

    @property
    def in_step(self) -> Bool[np.ndarray, " _"]:
        """True for an interval with an edge in step with the samples, shape (n - 1,)."""
        return np.zeros(self.edge.size, dtype=bool) if self.turn is None else np.isfinite(self.turn)


def edges_of(value: Float[np.ndarray, " n"], sigma: float) -> Bool[np.ndarray, " n-1"]:
    """Intervals in which the input jumps: by far more than the noise and than its changes nearby."""
    jump = np.abs(np.diff(value))
    edge = jump > _EDGE * np.sqrt(2.0) * sigma
    if jump.size < 3 or not edge.any():
        return edge
    padded = np.pad(jump, 4, mode="reflect" if jump.size > 4 else "edge")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 9)[edge], axis=1)
    edge[edge] = jump[edge] > 4.0 * around
    return edge


def _savitzky_golay(reach: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Weights a + b j^2, |j| <= reach, that give the centre of a parabola; a is also their variance."""
    width = 2.0 * reach + 1.0
    m2 = reach * (reach + 1.0) * width / 3.0
    m4 = m2 * (3.0 * reach**2 + 3.0 * reach - 1.0) / 5.0
    determinant = np.where(reach >= 2, width * m4 - m2**2, 1.0)
    return np.where(reach >= 2, m4 / determinant, 1.0), np.where(reach >= 2, -m2 / determinant, 0.0)


_CENTRE, _CURVED = _savitzky_golay(np.arange(_WINDOWS[-1] + 1))  # a and b, by reach


class _Curves(NamedTuple):
    """Edge-free stretches that are not straight, concatenated: N samples of K stretches."""

    value: Float[np.ndarray, " N"]  # logged values
    first: Float[np.ndarray, " N"]  # the first sample of the own stretch
    place: Int[np.ndarray, " N"]  # index of a sample in `sums`
    inside: Int[np.ndarray, " N"]  # number of samples of the own stretch before or after it, whichever is smaller
    centre: Float[np.ndarray, " N"]  # place in the own stretch, from its middle
    # sums of the samples before, times place^0, place^1, place^2; from 0 for each stretch
    sums: Float[np.ndarray, "3 N+K"]

    @classmethod
    def of_stretches(cls, stretches: Sequence[Float[np.ndarray, " _"]]) -> _Curves:
        """Many stretches at once: most are so short that a call takes longer than its arithmetic."""
        size = np.array([stretch.size for stretch in stretches])
        begin = np.cumsum(size) - size
        value, n = np.concatenate(stretches), np.repeat(size, size)
        index = np.arange(value.size) - np.repeat(begin, size)
        first, centre = np.repeat(value[begin], size), index - n / 2
        terms = (value - first) * np.stack([centre**k for k in range(3)])
        sums = np.zeros((3, value.size + size.size))
        for k, (a, b) in enumerate(zip(begin, begin + size, strict=True)):
            np.cumsum(terms[:, a:b], axis=1, out=sums[:, a + k + 1 : b + k + 1])
        place = np.arange(value.size) + np.repeat(np.arange(size.size), size)
        return cls(value, first, place, np.minimum(index, n - 1 - index), centre, sums)

    def at(self, rows: Int[np.ndarray, " R"]) -> _Curves:
        """Some of the samples."""
        own = (self.value, self.first, self.place, self.inside, self.centre)
        value, first, place, inside, centre = (each[rows] for each in own)
        return _Curves(value, first, place, inside, centre, self.sums)

    def centres(self, reach: Int[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Centres of the parabolas through `reach` samples on either side."""
        s0, s1, s2 = self.sums[:, self.place + reach + 1] - self.sums[:, self.place - reach]
        c = self.centre
        return self.first + _CENTRE[reach] * s0 + _CURVED[reach] * (s2 - 2.0 * c * s1 + c**2 * s0)


def _parabolas(curves: _Curves, sigma: float) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Estimate and effective number of samples averaged."""
    best, count = curves.value.astype(float), np.ones(curves.value.size)
    rows = np.flatnonzero(curves.inside >= _WINDOWS[0])  # samples whose window still grows
    here, low, high = curves.at(rows), best[rows] - _GAMMA * sigma, best[rows] + _GAMMA * sigma
    for half in _WINDOWS:
        reach = np.minimum(half, here.inside)
        mean, spread = here.centres(reach), _GAMMA * sigma * np.sqrt(_CENTRE[reach])
        low, high = np.maximum(low, mean - spread), np.minimum(high, mean + spread)
        good = low <= high
        best[rows[good]], count[rows[good]] = mean[good], 1.0 / _CENTRE[reach[good]]
        on = np.flatnonzero(good & (here.inside > half))
        rows, here, low, high = rows[on], here.at(on), low[on], high[on]
    return best, count


def _line(value: Float[np.ndarray, " n"], sigma: float) -> Float[np.ndarray, " n"] | None:
    """The straight line through a stretch, also if it is level; None if the stretch is not straight.

    A mean in place of an insignificant slope would have a bias that its error does not include.
    """
    if value.size < _LEVEL or _is_plainly_curved(value, sigma):
        return None
    line = _least_squares(value)
    return line if _is_white(value - line, sigma) else None


def _is_plainly_curved(value: Float[np.ndarray, " n"], sigma: float) -> bool:
    """Whether the best line through a few samples of a long stretch has a larger error than is allowed for all."""
    few = value[::_FEW]
    if few.size < _LEVEL:
        return False
    rest = few - _least_squares(few)
    return bool(rest @ rest > _error_of_a_line(value.size, sigma))


def _least_squares(value: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    t = _from_the_middle(value.size)
    return value.mean() + (t @ value) / (t @ t) * t


def _from_the_middle(n: int) -> Float[np.ndarray, " n"]:
    """-1 to 1."""
    return np.arange(1.0 - n, n, 2.0) / (n - 1.0)


def _is_white(rest: Float[np.ndarray, " n"], sigma: float) -> bool:
    if rest @ rest >= _error_of_a_line(rest.size, sigma):
        return False
    return bool(np.max(np.abs(np.cumsum(rest))) < _DRIFT * sigma * np.sqrt(rest.size))


def _error_of_a_line(n: int, sigma: float) -> float:
    """The largest sum of squared residuals of a straight stretch."""
    return n * (1.5 * sigma) ** 2


def _corner(value: Float[np.ndarray, " n"]) -> int:
    """The sample, away from the ends, at which a curved stretch is farthest from its chord."""
    n = value.size
    width = max(1, n // 50)
    sums = np.concatenate(([0.0], np.cumsum(value - value[0])))
    smooth = (sums[width:] - sums[:-width]) / width
    chord = np.linspace(smooth[0], smooth[-1], smooth.size)
    return int(np.clip(np.argmax(np.abs(smooth - chord)) + width // 2, _STRETCH // 2, n - _STRETCH // 2))


class _Stretch(NamedTuple):
    """An edge-free stretch, samples a to b; its line if it is straight within the noise, None if it is curved."""

    a: int
    b: int
    line: Float[np.ndarray, " _"] | None


def _stretches(value: Float[np.ndarray, " n"], sigma: float, edge: Bool[np.ndarray, " n-1"]) -> Iterator[_Stretch]:
    """All stretches of a trace, in any order; a long one that is not straight is cut in two and tried again."""
    waiting = list(pairwise([0, *(np.flatnonzero(edge) + 1).tolist(), value.size]))
    while waiting:
        a, b = waiting.pop()
        line = _line(value[a:b], sigma)
        if line is None and b - a >= 2 * _STRETCH:
            at = a + _corner(value[a:b])
            waiting += [(a, at), (at, b)]
        else:
            yield _Stretch(a, b, line)


def _batches(stretches: Sequence[_Stretch]) -> Iterator[list[_Stretch]]:
    """Batches of stretches that fit into the processor's cache."""
    number = iter(np.cumsum([each.b - each.a for each in stretches]) // _AT_ONCE)
    for _, batch in groupby(stretches, key=lambda _: next(number)):
        yield list(batch)


class _Estimate(NamedTuple):
    """The estimate of every sample."""

    value: Float[np.ndarray, " n"]  # V or N m
    variance: Float[np.ndarray, " n"]  # variance of its error, over sigma^2
    shared: Float[np.ndarray, " n"]  # number of consecutive samples with nearly the same error


def _estimated(value: Float[np.ndarray, " n"], sigma: float, edge: Bool[np.ndarray, " n-1"]) -> _Estimate:
    """Estimate every stretch: by a line if it is straight within the noise, by parabolas otherwise."""
    known, curved = _Estimate(*np.empty((3, value.size))), list[_Stretch]()
    for each in _stretches(value, sigma, edge):
        if each.line is None:
            curved.append(each)
        else:
            n, t = each.b - each.a, _from_the_middle(each.b - each.a)
            _keep(known, [each], each.line, (1.0 + 3.0 * t**2) / n, np.full(n, float(n)))
    for batch in _batches(curved):
        estimate, count = _parabolas(_Curves.of_stretches([value[each.a : each.b] for each in batch]), sigma)
        # variance due to the choice of windows, measured on multisines, chirps and trapezoids (test_input_signal.py)
        _keep(known, batch, estimate, np.where(count > 1.0, 1.6, 1.0) / count, np.maximum(1.0, count / 1.5))
    return known


def _keep(known: _Estimate, stretches: Sequence[_Stretch], *found: Float[np.ndarray, " _"]) -> None:
    """Write the concatenated results of these stretches to their places in the trace."""
    stops = np.cumsum([each.b - each.a for each in stretches])[:-1]
    for whole, part in zip(known, found, strict=True):
        for each, own in zip(stretches, np.split(part, stops), strict=True):
            whole[each.a : each.b] = own


def denoise(value: Float[np.ndarray, " n"], sigma: float) -> InputSignal:
    """A logged input averaged between its edges, where it is straight or smooth; see the module's head.

    Args:
        value: logged input, V or N m, shape (n,).
        sigma: standard deviation of its noise, unit of the value.
    Returns:
        The signal, its remaining error and its edges.
    """
    edge = edges_of(value, sigma)
    estimate, variance, count = _estimated(value, sigma, edge)
    memory = np.where(count > 1.0, np.exp(-2.0 / np.maximum(count, 1.0)), 0.0)
    return InputSignal(estimate, sigma * np.sqrt(variance), memory, edge)


def _on(instants: Float[np.ndarray, " n"], channel: Channel) -> Float[np.ndarray, " n"]:
    return np.interp(instants, channel.time, channel.value)


def _duty(measurement: Measurement, config: RigConfig, instants: Float[np.ndarray, " n"]) -> InputSignal:
    duty = measurement.channels["duty"]
    supply = measurement.channels.get("supply")
    level = np.full(instants.size, config.supply_V)
    if supply is not None:  # smooth the reading's noise, which the battery does not have and the duty would multiply
        level = denoise(_on(instants, supply), supply.sigma).value
    latest = np.clip(np.searchsorted(duty.time, instants, side="right") - 1, 0, None)
    zero = np.zeros(instants.size)
    return InputSignal(duty.value[latest] * level, zero, zero, zero[1:] > 0.0, held=True)


def commanded(instants: Float[np.ndarray, " n"], supply: float) -> InputSignal:
    """The initial voltage in the integral of an ECU that is part of the model, to which it adds its terms.

    It is one number for the whole trace, which was not logged: assumed 0 until the model shows it, with a standard
    deviation of a quarter of the supply.

    Args:
        instants: s, shape (n,).
        supply: V.
    """
    level, error = np.zeros(instants.size), np.full(instants.size, 0.25 * supply)
    return InputSignal(level, error, np.ones(instants.size), np.zeros(instants.size - 1, dtype=bool))


def input_of(measurement: Measurement, config: RigConfig, instants: Float[np.ndarray, " n"]) -> InputSignal | None:
    """The input of a trace: voltage, or duty times supply, or torque; None if it logged none of them.

    Args:
        config: its rig, for supply and effects.
        instants: instants of the result, s, shape (n,).
    """
    for name in ("voltage", "torque"):
        if name in measurement.channels:
            channel = measurement.channels[name]
            return _in_step(denoise(_on(instants, channel), channel.sigma), measurement, config)
    if "duty" in measurement.channels and ("supply" in measurement.channels or config.supply_V):
        return _duty(measurement, config, instants)
    return None


def _in_step(signal: InputSignal, measurement: Measurement, config: RigConfig) -> InputSignal:
    """The signal with its edges in step with the samples, if the config says so of the rig test; all edges if they were
    not examined."""
    if EdgePhase.at(Place(measurement.test)).name not in config.effects or not signal.edge.any():
        return signal
    turn = np.zeros(signal.edge.size) if measurement.edge_turn is None else measurement.edge_turn
    return replace(signal, turn=np.where(signal.edge, turn, np.nan))
