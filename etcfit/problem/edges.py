"""Edges: intervals in which the input of a trace jumps, as columns over its integration steps.

Either the instant is unknown, and the whitening includes its uncertainty; or the edges of a rig test are in step with
the samples, all at one share s of their intervals, which is a parameter of the fit (`rig_effects.EdgePhase`). Steps of
the latter are made for s = 1/2: half of them before the jump and half after it; `model.stepper.Edge` holds their
dependence on s.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from .trace import Trace

_MIDDLE = 0.5 + 1e-9  # middle of an interval, with a margin for rounding


def halved(trace: Trace, substeps: Int[np.ndarray, " intervals"]) -> Int[np.ndarray, " intervals"]:
    """Integration steps in each interval, an even number if an edge is in step with the samples."""
    if trace.input is None or trace.input.turn is None:
        return substeps
    return np.where(trace.input.in_step, 2 * ((substeps + 1) // 2), substeps)


def levels(
    trace: Trace, ends: Float[np.ndarray, " rows"], interval: Int[np.ndarray, " rows"]
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """The input at the begin and the end of each step, V, or N m for a torque; 0 without an input.

    Args:
        ends: ends of its steps, s.
        interval: interval of each step.
    """
    if trace.input is None:
        return np.zeros(ends.size), np.zeros(ends.size)
    if trace.input.held:
        level = trace.input.value[interval]
        return level, level
    late = np.interp(ends, trace.instants, trace.input.value)
    early = np.concatenate((late[:1], late[:-1]))
    if trace.input.turn is None:
        return early, late
    jumps = trace.input.in_step[interval]
    level = trace.input.value[interval + (_along(trace, ends, interval) > _MIDDLE)]
    return np.where(jumps, level, early), np.where(jumps, level, late)


def in_step(
    trace: Trace, ends: Float[np.ndarray, " rows"], interval: Int[np.ndarray, " rows"]
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Columns of `Edge` for the edges in step with the samples; {} if the trace has no such edge.

    Args:
        ends: ends of its steps, s.
        interval: interval of each step.
    """
    if trace.input is None or trace.input.turn is None:
        return {}
    jumps, along = trace.input.in_step[interval], _along(trace, ends, interval)
    jumps[0] = False  # entry 0 is the start itself
    before = along <= _MIDDLE
    span = np.where(before, 2.0, -2.0) * np.diff(ends, prepend=ends[0])
    moves = 2.0 * np.where(before, along, 1.0 - along) * np.diff(trace.instants)[interval]
    return {name: np.where(jumps, column, 0.0) for name, column in
            (("turn", trace.input.turn[interval]), ("span", span), ("moves", moves))}  # fmt: skip


def unplaced(trace: Trace, marks: Int[np.ndarray, " n"], entries: int) -> dict[str, Float[np.ndarray, " {entries}"]]:
    """Columns of `Disturbance` for the jumps at unknown instants, each at the last entry of its interval.

    Args:
        marks: entry of each of its instants.
        entries: number of entries of the trace.
    """
    out = {name: np.zeros(entries) for name in ("edge", "edge_from", "edge_to", "edge_span")}
    if trace.input is not None:
        (jumps,) = np.nonzero(trace.input.edge & ~trace.input.in_step)
        last = marks[jumps + 1]
        out["edge"][last] = marks[jumps + 1] - marks[jumps]
        out["edge_from"][last], out["edge_to"][last] = trace.input.value[jumps], trace.input.value[jumps + 1]
        out["edge_span"][last] = trace.instants[jumps + 1] - trace.instants[jumps]
    return out


def _along(
    trace: Trace, ends: Float[np.ndarray, " rows"], interval: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    """Share of its interval at which each step ends."""
    begin, end = trace.instants[interval], trace.instants[interval + 1]
    return (ends - begin) / (end - begin)
