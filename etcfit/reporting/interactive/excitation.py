"""What drives a trace, for the page's own simulation: corners of the input, the rig's circuit, the state it begins in.

It is read off the steps on which the fit itself runs, so that edges, series resistances, release instants and whatever
stands between rig and throttle are where the fit has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...model.rig_effects import number_of
from ...model.throttle import Throttle
from ...problem.problem import EstimationProblem
from ...problem.residual import equipped
from ...problem.trace import Trace

_FINEST = 1e-5  # of the input's span; by so little its corners may miss it where there is room for them
_CHANNELS = ("current", "position", "emf", "motor_speed")


@dataclass(frozen=True, eq=False)
class Excitation:
    """The input and circuit of one trace, SI.

    Args:
        time, level: corners of the input, s and V (N m where torque drives), shape (K,); a jump has two at one instant.
        within: by how much the input may be missed, unit of the level.
        boundary: circuit, plate, series resistance, gear ratio and stops, by the stepper's names.
        start: current (A), angle (rad), speed (rad/s).
        release: when a held plate is let go, s; infinite where it never is.
        readings: gain and zero of each channel as the rig logs it, where they are not 1 and 0.
        lacks: what the page's simulation leaves out of this trace, in words.
    """

    time: np.ndarray
    level: np.ndarray
    within: float
    boundary: Mapping[str, float]
    start: tuple[float, float, float]
    release: float
    readings: Mapping[str, tuple[float, float]]
    lacks: tuple[str, ...]


def excitations(problem: EstimationProblem, x: np.ndarray, most: int) -> list[Excitation | str]:
    """Of every trace of a problem at x, shape (P,), with so many corners at most; a sentence where the page cannot."""
    values = problem.layout.values(x, problem.free_parameters.held)
    throttle = Throttle.build(problem.layout.types, values)
    batch = problem.arrays()
    steps, resets = equipped(throttle, batch.steps, batch.resets, batch.test_of, values)
    columns = {name: np.asarray(each) for name, each in steps._asdict().items()
               if each is not None and not isinstance(each, tuple)}  # fmt: skip
    starts = {name: np.asarray(getattr(resets, name)) for name in ("i", "theta", "omega")}
    late = {name: np.asarray(by) for name, by in throttle.lateness(steps, batch.test_of).items()}
    out: list[Excitation | str] = []
    for trace, (lane, row, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        own = {
            name: np.broadcast_to(column, columns["dt"].shape)[row : marks[-1] + 1, lane]
            for name, column in columns.items()
        }
        state = tuple(float(starts[name][row, lane]) for name in ("i", "theta", "omega"))
        lags = [name for name, by in late.items() if np.any(np.broadcast_to(by, columns["dt"].shape)[row, lane] != 0.0)]
        whose = (number_of(trace.test.name), number_of(trace.measurement.file))
        out.append(_of_trace(trace, own, state, _readings(throttle, *whose), lags, most))
    return out


def _of_trace(
    trace: Trace,
    steps: Mapping[str, np.ndarray],
    start: tuple[float, ...],
    readings: Mapping[str, tuple[float, float] | None],
    lags: list[str],
    most: int,
) -> Excitation | str:
    if trace.controlled:
        return "An ECU inside the model drives this trace; the page does not simulate that one."
    time = float(trace.instants[0]) + np.cumsum(steps["dt"])
    begin, end = (steps[f"{'torque' if trace.torque_driven else 'voltage'}{k}"] for k in (0, 1))
    corners = _polyline(time, begin, end)
    within, (t, level) = _FINEST * float(np.ptp(corners[1])), corners
    kept = thinned(t, level, within)
    while kept.size > most:
        within = max(4.0, kept.size / most) * within or 1e-12
        kept = thinned(t, level, within)
    free = np.flatnonzero(steps["mobile"] > 0.5)
    release = float(time[max(free[0] - 1, 0)]) if free.size else np.inf
    fixed = ("circuit", "plate", "series", "gear_ratio", "lower", "upper")
    lacks = [f"{name.replace('_', ' ')} is logged late" for name in lags]
    lacks += [f"what the rig does to {name.replace('_', ' ')}" for name, line in readings.items() if line is None]
    told = {name: line for name, line in readings.items() if line is not None and line != (1.0, 0.0)}
    boundary = {name: float(steps[name][-1]) for name in fixed}
    i, theta, omega = start
    return Excitation(t[kept], level[kept], within, boundary, (i, theta, omega), release, told, tuple(lacks))


def _polyline(time: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what goes straight from begin to end in each step; the first step has no length."""
    t = np.repeat(time, 2)[1:-1]
    level = np.stack([begin[1:], end[1:]], axis=1).ravel()
    if not level.size:
        return time, end
    fresh = np.append(True, (np.diff(t) > 0.0) | (np.diff(level) != 0.0))
    return t[fresh], level[fresh]


def thinned(t: np.ndarray, level: np.ndarray, within: float) -> np.ndarray:
    """Corners that are kept, both ends among them, so that straight lines between them miss none by more; jumps stay.

    One pass: from a corner kept, the slopes that pass all later ones closely enough are a cone, which closes.

    Source: Sklansky and Gonzalez 1980, Pattern Recognition 12(5) (the cone intersection). Differs from source: the
    first corner outside of the cone ends a piece, and no piece straddles a jump.
    Args:
        t: instants, s, shape (K,), not falling.
        level: shape (K,).
        within: unit of the level.
    """
    instants, levels = t.tolist(), level.tolist()
    kept, flattest, steepest = [0], -np.inf, np.inf
    for k in range(1, len(instants)):
        span = instants[k] - instants[kept[-1]]
        jump = instants[k] <= instants[k - 1]
        slope = (levels[k] - levels[kept[-1]]) / span if span > 0.0 else np.inf
        if jump or not flattest <= slope <= steepest:
            if kept[-1] != k - 1:
                kept.append(k - 1)
            flattest, steepest = -np.inf, np.inf
            if jump:
                kept.append(k)
                continue
            span = instants[k] - instants[k - 1]
        rise = levels[k] - levels[kept[-1]]
        flattest, steepest = max(flattest, (rise - within) / span), min(steepest, (rise + within) / span)
    last = len(instants) - 1
    return np.array(kept if kept[-1] == last else [*kept, last])


def _readings(throttle: Throttle, test_of: float, trace: float) -> dict[str, tuple[float, float] | None]:
    """Gain and zero of each channel as the rig logs it in a trace; None where that is no straight line."""

    def read(level: float) -> dict[str, float]:
        seen = {name: np.float64(level) for name in _CHANNELS}
        shown = throttle.read(seen, np.float64(test_of), np.float64(trace))
        return {name: float(value) for name, value in shown.items()}

    if not throttle.rig:
        return {}
    zero, one, two = read(0.0), read(1.0), read(2.0)
    out: dict[str, tuple[float, float] | None] = {}
    for name in _CHANNELS:
        gain = one[name] - zero[name]
        straight = abs(two[name] - zero[name] - 2.0 * gain) <= 1e-9 * (abs(gain) + abs(zero[name]))
        out[name] = (gain, zero[name]) if straight else None
    return out
