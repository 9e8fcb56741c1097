"""Signals shifted in time along a batch: an input that acts late, a channel that is logged late.

A shift (`Earlier`, `Between`) holds the instants at which signals are read, and reads any signal there. A shifted
signal is linear in the signal, so tangents are shifted in the same way, and its derivative in the delay is minus its
rate of change: if xp is NumPy, these two rules give the derivatives. JAX differentiates by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .parameters import AnyArray, Scalar
from .stepper import Acting, Reset, Step


class Earlier(NamedTuple):
    """An instant before each entry of a batch, never before its trace began, shape (T, L) each."""

    row: Int[AnyArray, "T L"]  # the last entry at or before the instant
    share: Float[AnyArray, "T L"]  # its place in the step after that entry, as a share
    span: Float[AnyArray, "T L"]  # length of that step, s
    # 1 where a longer delay moves the instant, 0 at the begin of the trace; 0.5 at the border
    moves: Float[AnyArray, "T L"]

    def between(self, first: Float[AnyArray, "*K T L"], then: Float[AnyArray, "*K T L"]) -> Float[AnyArray, "*K T L"]:
        """Linear interpolation at the instant, from values at that entry and the next."""
        return first + self.share * (then - first)

    def delayed(self, signal: Float[AnyArray, "*K T L"]) -> Float[AnyArray, "*K T L"]:
        """The signal at the instant, linear between entries."""
        return self.between(_taken(signal, self.row), _taken(signal, self.row + 1))

    def rate(self, signal: Float[np.ndarray, "T L"]) -> Float[np.ndarray, "T L"]:
        """Minus the derivative of `delayed` in the delay, 1/s."""
        return self.slope(_taken(signal, self.row), _taken(signal, self.row + 1))

    def slope(self, first: Float[np.ndarray, "T L"], then: Float[np.ndarray, "T L"]) -> Float[np.ndarray, "T L"]:
        """Minus the derivative of `between` in the delay."""
        return self.moves * _over(then - first, self.span)


class Between(NamedTuple):
    """An instant for each entry of a batch, within its trace, for reading by a cubic; shape (T, L) each."""

    # before, after: the entries around it
    before: Int[AnyArray, "T L"]
    after: Int[AnyArray, "T L"]
    s: Float[AnyArray, "T L"]  # its place in the step between them, as a share
    span: Float[AnyArray, "T L"]  # length of that step, s
    # 1 where another lateness moves the instant, 0 beyond an end of the trace; 0.5 at the border
    moves: Float[AnyArray, "T L"]
    # share, next_share: weights of the rises of the steps before and after an entry in the slope there, 1/s
    share: Float[AnyArray, "T L"]
    next_share: Float[AnyArray, "T L"]

    def delayed(self, signal: Float[AnyArray, "*K T L"], xp: Any = jnp) -> Float[AnyArray, "*K T L"]:
        """The signal at the instant."""
        s, (y0, y1, v0, v1) = self.s, self._ends(signal, xp)
        return y0 + s**2 * (3.0 - 2.0 * s) * (y1 - y0) + s * (1.0 - s) * ((1.0 - s) * v0 - s * v1) * self.span

    def rate(self, signal: Float[np.ndarray, "T L"]) -> Float[np.ndarray, "T L"]:
        """Minus the derivative of `delayed` in the lateness, 1/s."""
        s, (y0, y1, v0, v1) = self.s, self._ends(signal, np)
        bend = (1.0 - s) * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
        return self.moves * np.where(self.span > 0.0, 6.0 * s * (1.0 - s) * _over(y1 - y0, self.span) + bend, 0.0)

    def _ends(self, signal: Float[AnyArray, "*K T L"], xp: Any) -> tuple[Float[AnyArray, "*K T L"], ...]:
        """Values and slopes at the entries around the instant."""
        zero = xp.zeros_like(signal[..., :1, :])
        rise = xp.concatenate((zero, xp.diff(signal, axis=-2), zero), axis=-2)
        slopes = self.share * rise[..., :-1, :] + self.next_share * rise[..., 1:, :]
        return tuple(_taken(column, rows) for column in (signal, slopes) for rows in (self.before, self.after))


class LateInput(NamedTuple):
    """An input that acts late; each step has the mean of the input in it, jumps included."""

    # begins, ends: the instants whose level acts at the begin and the end of each step
    begins: Earlier
    ends: Earlier
    lead: Float[AnyArray, "T L"]  # part of each step before the first level of its trace would have acted, s
    dt: Float[AnyArray, "T L"]  # length of each step, s

    def acting(
        self, begin: Float[AnyArray, "T L"], end: Float[AnyArray, "T L"], xp: Any = jnp
    ) -> tuple[Float[AnyArray, "T L"], Float[AnyArray, "T L"]]:
        """The input at begin and end of each step; before a trace begins its first level acts."""
        area = running_sum(0.5 * (begin + end) * self.dt, xp)
        level0, area0 = _level(begin, end, area, self.begins)
        level1, area1 = _level(begin, end, area, self.ends)
        acts = self.dt > 0.0
        mean = (area1 - area0 + self.lead * level0) / xp.where(acts, self.dt, 1.0)
        swing = 0.5 * (level1 - level0)
        return xp.where(acts, mean - swing, begin), xp.where(acts, mean + swing, end)

    def rates(
        self, begin: Float[np.ndarray, "T L"], end: Float[np.ndarray, "T L"]
    ) -> tuple[Float[np.ndarray, "T L"], Float[np.ndarray, "T L"]]:
        """Minus the derivative of `acting` in the delay, 1/s."""
        (first0, then0), (first1, then1) = (
            tuple(_taken(column, at.row + 1) for column in (begin, end)) for at in (self.begins, self.ends)
        )
        rise = self.ends.between(first1, then1) - self.begins.between(first0, then0)
        mean = self.ends.moves * _over(rise, self.dt)
        swing = 0.5 * (self.ends.slope(first1, then1) - self.begins.slope(first0, then0))
        acts = self.dt > 0.0
        return np.where(acts, mean - swing, 0.0), np.where(acts, mean + swing, 0.0)


def _taken(column: Float[AnyArray, "*K T L"], rows: Int[AnyArray, "T L"]) -> Float[AnyArray, "*K T L"]:
    if isinstance(rows, np.ndarray):  # twice as fast as `take_along_axis`
        flat = np.asarray(column).reshape(*column.shape[:-2], -1)
        return np.take(flat, rows * rows.shape[1] + np.arange(rows.shape[1]), axis=-1)
    return jnp.take_along_axis(column, rows, axis=0)


def _over(change: Float[np.ndarray, "T L"], span: Float[np.ndarray, "T L"]) -> Float[np.ndarray, "T L"]:
    return np.where(span > 0.0, change / np.where(span > 0.0, span, 1.0), 0.0)


def _clock(steps: Step, resets: Reset, xp: Any) -> tuple[Float[AnyArray, "T L"], Float[AnyArray, "T L"]]:
    """Time along each lane, and the time at which the trace of each entry began, s."""
    clock = running_sum(steps.dt, xp)
    return clock, running_max(xp.where(resets.begins > 0.5, clock, 0.0), xp)


def _found(clock: Float[AnyArray, "T L"], instant: Float[AnyArray, "T L"], side: str, xp: Any) -> Int[AnyArray, "T L"]:
    """The first entry of each lane after an instant ("right"), or not before it ("left")."""
    clock = running_max(clock, xp)  # a phase of edges may make a step of negative length, which turns the clock back
    if xp is np:
        out = np.empty(instant.shape, dtype=int)
        for lane in range(instant.shape[1]):
            out[:, lane] = np.searchsorted(clock[:, lane], instant[:, lane], side)  # pyright: ignore[reportCallIssue, reportArgumentType]
        return out
    search = jax.vmap(lambda lane, wanted: jnp.searchsorted(lane, wanted, side=side), in_axes=1, out_axes=1)
    return search(jax.lax.stop_gradient(clock), jax.lax.stop_gradient(instant))


def _moves(
    instant: Float[AnyArray, "T L"], low: Float[AnyArray, "T L"], high: Float[AnyArray, "T L"] | float
) -> Float[AnyArray, "T L"]:
    """1 within, 0 outside, 0.5 at an end, as JAX differentiates a maximum."""
    return 0.5 * (1.0 * (instant > low) + (instant >= low) - (instant > high) - (instant >= high))


def _earlier(
    clock: Float[AnyArray, "T L"],
    began: Float[AnyArray, "T L"],
    instant: Float[AnyArray, "T L"],
    xp: Any,
    near: Earlier | None = None,
) -> Earlier:
    moves = _moves(instant, began, np.inf)
    instant = xp.maximum(instant, began)
    row = xp.clip(_found(clock, instant, "right", xp) - 1, 0, clock.shape[0] - 2) if near is None else near.row
    early = _taken(clock, row)
    span = _taken(clock, row + 1) - early
    share = xp.where(span > 0.0, (instant - early) / xp.where(span > 0.0, span, 1.0), 0.0)
    return Earlier(row, share, span, moves)


def earlier(steps: Step, resets: Reset, delay: Scalar, xp: Any = jnp, near: Earlier | None = None) -> Earlier:
    """Each entry's instant minus a delay (s, >= 0).

    Args:
        steps, resets: the batch, of xp, which is JAX or NumPy.
        delay: s.
        near: a shift whose entries are used again, for steps that differ little from it.
    """
    clock, began = _clock(steps, resets, xp)
    return _earlier(clock, began, clock - delay, xp, near)


def delayed(signal: Float[AnyArray, "T L"], steps: Step, resets: Reset, delay: Scalar) -> Float[Array, "T L"]:
    """signal(t - delay), linear between entries, with a trace's first value before its begin. Exact for a delay of 0.

    Args:
        signal: values at the end of each step, shape (T, L).
        delay: s, >= 0.
    """
    # the search along the batch takes as long as a simulation
    return jax.lax.cond(
        delay > 0.0, lambda signal: earlier(steps, resets, delay).delayed(signal), lambda signal: signal, signal
    )


def _trace_ends(resets: Reset, xp: Any) -> tuple[Int[AnyArray, "T L"], Int[AnyArray, "T L"]]:
    """The first and the last entry of each entry's trace."""
    begins = resets.begins > 0.5
    rows = begins.shape[0]
    entry = xp.broadcast_to(xp.arange(float(rows))[:, None], begins.shape)
    first = running_max(xp.where(begins, entry, 0.0), xp)
    next_begin = -running_max(xp.where(begins, -entry, -float(rows))[::-1], xp)[::-1]  # at or after an entry
    last = xp.concatenate((next_begin[1:], xp.full_like(next_begin[:1], float(rows)))) - 1.0
    return first.astype(int), last.astype(int)


def _shares(
    dt: Float[AnyArray, "T L"], first: Int[AnyArray, "T L"], last: Int[AnyArray, "T L"], xp: Any
) -> tuple[Float[AnyArray, "T L"], Float[AnyArray, "T L"]]:
    """Weights of the slope of the parabola through each entry and its neighbours in the trace; at an end, of the step
    there. See `Between`."""
    entry = xp.arange(dt.shape[0])[:, None]
    later = xp.concatenate((dt[1:], xp.zeros_like(dt[:1])))
    before, after = xp.where(entry > first, dt, 0.0), xp.where(entry < last, later, 0.0)
    both = xp.where(before + after > 0.0, before + after, 1.0)
    inner = (before > 0.0) & (after > 0.0)
    own = xp.where(inner, after / both, 1.0 * (before > 0.0))
    others = xp.where(inner, before / both, 1.0 * (before <= 0.0) * (after > 0.0))
    return own / xp.where(dt > 0.0, dt, 1.0), others / xp.where(later > 0.0, later, 1.0)


class Clock(NamedTuple):
    """The part of `Between` that does not depend on the lateness, shape (T, L) each."""

    dt: Float[AnyArray, "T L"]  # length of each step, s
    clock: Float[AnyArray, "T L"]  # time along each lane, s
    # first, last: entries at the ends of each entry's trace
    first: Int[AnyArray, "T L"]
    last: Int[AnyArray, "T L"]
    # began, ended: the times there, s
    began: Float[AnyArray, "T L"]
    ended: Float[AnyArray, "T L"]
    # share, next_share: see `Between`
    share: Float[AnyArray, "T L"]
    next_share: Float[AnyArray, "T L"]

    @classmethod
    def of_batch(cls, steps: Step, resets: Reset, xp: Any = jnp) -> Clock:
        """Of a batch."""
        clock, began = _clock(steps, resets, xp)
        first, last = _trace_ends(resets, xp)
        return cls(steps.dt, clock, first, last, began, _taken(clock, last), *_shares(steps.dt, first, last, xp))


def between(by: Clock, late: Scalar, xp: Any = jnp, near: Between | None = None) -> Between:
    """Each entry's instant minus a lateness (s, of either sign; shape (T, L), or one for all); see `earlier`."""
    clock, began, ended, first, last = by.clock, by.began, by.ended, by.first, by.last
    moves = _moves(clock - late, began, ended)
    instant = xp.clip(clock - late, began, ended)
    if near is None:
        after = xp.clip(_found(clock, instant, "left", xp), xp.minimum(first + 1, last), last)
    else:
        after = near.after
    span = _taken(by.dt, after)
    back = (_taken(clock, after) - instant) / xp.where(span > 0.0, span, 1.0)
    s = xp.where(span > 0.0, 1.0 - back, 1.0)
    return Between(xp.maximum(after - 1, 0), after, s, span, moves, by.share, by.next_share)


def logged_late(signal: Float[AnyArray, "T L"], steps: Step, resets: Reset, late: Scalar) -> Float[Array, "T L"]:
    """signal(t - late), for each trace by itself; beyond its ends its first or last value.

    Between entries it is a Hermite cubic with the slopes of parabolas through three entries: the value and its
        derivative
    in `late` are continuous even if a lateness is a whole number of samples. Linear interpolation would give chi2 a
    kink exactly there, where a logger's lateness is. Unlike `delayed` it also shifts forward, each entry by its own
    lateness, and has a derivative at lateness 0.

    Source: Hermite interpolation with the slopes of Catmull and Rom 1974 on uneven steps. Differs from source: no.
    Args:
        signal: values at the end of each step, shape (T, L).
        late: lateness, s, of either sign; shape (T, L), or one for all.
    """
    return between(Clock.of_batch(steps, resets), late).delayed(signal)


def late_input(steps: Step, resets: Reset, delay: Scalar, xp: Any = jnp, near: LateInput | None = None) -> LateInput:
    """An input that acts late by a delay (s, >= 0); see `earlier`."""
    clock, began = _clock(steps, resets, xp)
    end, begin = clock - delay, clock - steps.dt - delay
    lead = xp.maximum(began - begin, 0.0) - xp.maximum(began - end, 0.0)
    begins, ends = (None, None) if near is None else (near.begins, near.ends)
    return LateInput(_earlier(clock, began, begin, xp, begins), _earlier(clock, began, end, xp, ends), lead, steps.dt)


def late_inputs(steps: Step, resets: Reset, delay: Scalar) -> Step:
    """The batch with voltage and torque acting late; each step has the mean of the input in it, jumps included.

    Args:
        steps, resets: the batch, shape (T, L) each.
        delay: s, >= 0; before a trace begins its first level acts.
    """

    def acting(logged: Acting) -> Acting:
        late = late_input(steps, resets, delay)
        return Acting(*late.acting(*logged[:2]), *late.acting(*logged[2:]))

    return steps._replace(**jax.lax.cond(delay > 0.0, acting, lambda logged: logged, steps.levels)._asdict())


def _level(
    begin: Float[AnyArray, "T L"], end: Float[AnyArray, "T L"], area: Float[AnyArray, "T L"], at: Earlier
) -> tuple[Float[AnyArray, "T L"], Float[AnyArray, "T L"]]:
    """A piecewise linear input, and its integral from the lane's begin, at earlier instants."""
    first, last = (_taken(column, at.row + 1) for column in (begin, end))
    level = at.between(first, last)
    return level, _taken(area, at.row) + 0.5 * (first + level) * at.share * at.span


# JAX's own functions (`jnp.cumsum`, `lax.cummax`) become trees of slices, which XLA's CPU backend compiles for seconds,
# once for every length: these are loops
def running_sum(x: Float[AnyArray, "T ..."], xp: Any = jnp) -> Float[AnyArray, "T ..."]:
    """sum_{j <= k} x_j along the first axis, unit and shape of x; by NumPy if xp is NumPy."""
    if xp is np:
        return np.cumsum(x, axis=0)

    def add(total: Array, each: Array) -> tuple[Array, Array]:
        return (total := total + each), total

    return jax.lax.scan(add, jnp.zeros_like(x[0]), x)[1]


def running_max(x: Float[AnyArray, "T ..."], xp: Any = jnp) -> Float[AnyArray, "T ..."]:
    """max_{j <= k} x_j along the first axis, unit and shape of x; by NumPy if xp is NumPy."""
    if xp is np:
        return np.maximum.accumulate(x, axis=0)

    def higher(most: Array, each: Array) -> tuple[Array, Array]:
        return (most := jnp.maximum(most, each)), most

    return jax.lax.scan(higher, jnp.full_like(x[0], -jnp.inf), x)[1]
