"""Signals shifted in time along a batch: an input that acts late, a channel that is logged late."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .parameters import AnyArray, Scalar
from .running import running_max, running_sum
from .stepper import Reset, Step


class _Earlier(NamedTuple):
    """An instant before each entry of a batch, never before its trace began, shape (T, L) each.

    Args:
        row: the last entry at or before it.
        share: of the step after that entry.
        span: length of that step, s.
    """

    row: Int[Array, "T L"]
    share: Float[Array, "T L"]
    span: Float[Array, "T L"]


def _clock(steps: Step, resets: Reset) -> tuple[Float[Array, "T L"], Float[Array, "T L"]]:
    """Time along each lane, and that at which the trace at each entry began, s."""
    clock = running_sum(steps.dt)
    return clock, running_max(jnp.where(resets.begins > 0.5, clock, 0.0))


def _earlier(clock: Float[Array, "T L"], began: Float[Array, "T L"], instant: Float[Array, "T L"]) -> _Earlier:
    instant = jnp.maximum(instant, began)
    search = jax.vmap(lambda lane, wanted: jnp.searchsorted(lane, wanted, side="right"), in_axes=1, out_axes=1)
    row = jnp.clip(search(clock, jax.lax.stop_gradient(instant)) - 1, 0, clock.shape[0] - 2)
    early = jnp.take_along_axis(clock, row, axis=0)
    span = jnp.take_along_axis(clock, row + 1, axis=0) - early
    share = jnp.where(span > 0.0, (instant - early) / jnp.where(span > 0.0, span, 1.0), 0.0)
    return _Earlier(row, share, span)


def delayed(signal: Float[AnyArray, "T L"], steps: Step, resets: Reset, delay: Scalar) -> Float[Array, "T L"]:
    """signal(t - delay), linear between entries; before a trace began its first value. Exactly the signal at 0.

    Args:
        signal: at the end of each step, shape (T, L).
        steps, resets: the batch.
        delay: s, >= 0.
    """

    def shifted(signal: Float[Array, "T L"]) -> Float[Array, "T L"]:
        clock, began = _clock(steps, resets)
        at = _earlier(clock, began, clock - delay)
        first = jnp.take_along_axis(signal, at.row, axis=0)
        then = jnp.take_along_axis(signal, at.row + 1, axis=0)
        return first + at.share * (then - first)

    # the search along the batch costs as much as simulating it
    return jax.lax.cond(delay > 0.0, shifted, lambda signal: signal, signal)


def _ends(resets: Reset) -> tuple[Int[Array, "T L"], Int[Array, "T L"]]:
    """The first and the last entry of the trace to which each entry belongs."""
    begins = resets.begins > 0.5
    rows = begins.shape[0]
    entry = jnp.broadcast_to(jnp.arange(float(rows))[:, None], begins.shape)
    first = running_max(jnp.where(begins, entry, 0.0))
    next_begin = -running_max(jnp.where(begins, -entry, -float(rows))[::-1])[::-1]  # at or after an entry
    last = jnp.concatenate((next_begin[1:], jnp.full_like(next_begin[:1], float(rows)))) - 1.0
    return first.astype(int), last.astype(int)


def _slopes(
    signal: Float[AnyArray, "T L"], dt: Float[AnyArray, "T L"], first: Int[Array, "T L"], last: Int[Array, "T L"]
) -> Float[Array, "T L"]:
    """Of the parabola through each entry and its neighbours in the trace; at an end, of the step there."""
    entry = jnp.arange(dt.shape[0])[:, None]
    zero = jnp.zeros_like(dt[:1])
    rise = jnp.concatenate((zero, jnp.diff(signal, axis=0)))
    slope = jnp.where(dt > 0.0, rise / jnp.where(dt > 0.0, dt, 1.0), 0.0)
    before = jnp.where(entry > first, dt, 0.0)
    after = jnp.where(entry < last, jnp.concatenate((dt[1:], zero)), 0.0)
    both = before + after
    mean = slope * after + jnp.concatenate((slope[1:], zero)) * before
    inner = (before > 0.0) & (after > 0.0)
    end = jnp.where(before > 0.0, slope, jnp.where(after > 0.0, jnp.concatenate((slope[1:], zero)), 0.0))
    return jnp.where(inner, mean / jnp.where(both > 0.0, both, 1.0), end)


def logged_late(signal: Float[AnyArray, "T L"], steps: Step, resets: Reset, late: Scalar) -> Float[Array, "T L"]:
    """signal(t - late), each trace by itself; beyond its ends its first or last value.

    Between entries a cubic of Hermite's with the slopes of parabolas through three entries: what is read off, and its
    derivative in `late`, are continuous also where a lateness is a whole number of samples. With straight lines chi2
    had a kink just there, where a logger's lateness is. Unlike `delayed` it goes forward as well, each entry by its own
    lateness, and has a derivative where that is 0.

    Source: Hermite interpolation with the slopes of Catmull and Rom 1974 on uneven steps. Differs from source: no.
    Args:
        signal: at the end of each step, shape (T, L).
        steps, resets: the batch.
        late: s, of either sign; shape (T, L), or one for all.
    """
    clock, began = _clock(steps, resets)
    first, last = _ends(resets)
    ended = jnp.take_along_axis(clock, last, axis=0)
    instant = jnp.clip(clock - late, began, ended)
    search = jax.vmap(lambda lane, wanted: jnp.searchsorted(lane, wanted), in_axes=1, out_axes=1)
    after = search(jax.lax.stop_gradient(clock), jax.lax.stop_gradient(instant))
    after = jnp.clip(after, jnp.minimum(first + 1, last), last)
    before = jnp.maximum(after - 1, 0)

    def at(column: Float[AnyArray, "T L"], rows: Int[Array, "T L"]) -> Float[Array, "T L"]:
        return jnp.take_along_axis(column, rows, axis=0)

    span, slopes = at(steps.dt, after), _slopes(signal, steps.dt, first, last)
    back = (at(clock, after) - instant) / jnp.where(span > 0.0, span, 1.0)
    s = jnp.where(span > 0.0, 1.0 - back, 1.0)
    straight = s**2 * (3.0 - 2.0 * s)
    bend = s * (1.0 - s) * ((1.0 - s) * at(slopes, before) - s * at(slopes, after)) * span
    return at(signal, before) + straight * (at(signal, after) - at(signal, before)) + bend


def late_inputs(steps: Step, resets: Reset, delay: Scalar) -> Step:
    """The batch with voltage and torque acting late; each step keeps the mean of what acts in it, jumps included.

    Args:
        steps, resets: the batch, shape (T, L) each.
        delay: s, >= 0; before a trace began its first level acted.
    """
    as_logged = steps.voltage0, steps.voltage1, steps.torque0, steps.torque1
    acting = jax.lax.cond(delay > 0.0, lambda _: _acting(steps, resets, delay), lambda logged: logged, as_logged)
    return steps._replace(**dict(zip(("voltage0", "voltage1", "torque0", "torque1"), acting, strict=True)))


def _acting(steps: Step, resets: Reset, delay: Scalar) -> tuple[Float[AnyArray, "T L"], ...]:
    """Voltage and torque at begin and end of each step, acting late."""
    clock, began = _clock(steps, resets)
    late, early = _earlier(clock, began, clock - delay), _earlier(clock, began, clock - steps.dt - delay)

    def shifted(
        start: Float[AnyArray, "T L"], end: Float[AnyArray, "T L"]
    ) -> tuple[Float[Array, "T L"], Float[Array, "T L"]]:
        area = running_sum(0.5 * (start + end) * steps.dt)
        level0, area0 = _level(start, end, area, early)
        level1, area1 = _level(start, end, area, late)
        # before the trace began its first level acted
        lead = jnp.maximum(began - (clock - steps.dt - delay), 0.0) - jnp.maximum(began - (clock - delay), 0.0)
        mean = (area1 - area0 + lead * level0) / jnp.where(steps.dt > 0.0, steps.dt, 1.0)
        slope = level1 - level0
        acts = steps.dt > 0.0
        return jnp.where(acts, mean - 0.5 * slope, start), jnp.where(acts, mean + 0.5 * slope, end)

    return (*shifted(steps.voltage0, steps.voltage1), *shifted(steps.torque0, steps.torque1))


def _level(
    start: Float[AnyArray, "T L"], end: Float[AnyArray, "T L"], area: Float[Array, "T L"], at: _Earlier
) -> tuple[Float[Array, "T L"], Float[Array, "T L"]]:
    """A piecewise linear input and its integral from the lane's begin, at earlier instants."""
    first, last = (jnp.take_along_axis(column, at.row + 1, axis=0) for column in (start, end))
    level = first + at.share * (last - first)
    done = jnp.take_along_axis(area, at.row, axis=0)
    return level, done + 0.5 * (first + level) * at.share * at.span
