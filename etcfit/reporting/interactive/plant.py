"""Model, ECU and setpoint of the page's simulation: values, sliders, JavaScript printed from the fit's functions.

    etcfit.model.advance(p, x, u, out)     state and memories after a step              stepper.step
    etcfit.model.first(p, x, u, out)       memories with which a trace begins          Throttle.first
    etcfit.model.read(p, x, u, out)        CHANNELS as their sensors show them          Throttle.observe
    etcfit.model.delays(p, out)            of input, position and current, s            Throttle.delays
    etcfit.ecu.begin(gains, ecu, angle, out)                memory of a PID at rest     Memory.at_rest
    etcfit.ecu.tick(gains, ecu, memory, sees, out)          memory and voltage after    ecu.tick
    etcfit.ecu.memories                                     number of a PID's memories
    etcfit.ecu.lag(steps, sees, out)                        input filter of the ECU     loop.lagging

p: parameters (SI) by symbol; x: current, angle, speed and memories; u: fields of `Step` by name.

The inputs of a trace (corners of the input, the rig's circuit, the initial state) come from the steps of the fit
itself, so that edges, series resistances, release instants and rig effects are those of the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ...control.pid.loop import lagging
from ...control.setpoint import trapezoid
from ...control.settings import LoopSettings
from ...estimation.fitted_model import body_types
from ...estimation.result import FitResult
from ...kernels.graph import Graph
from ...kernels.infix import NotWrittenError
from ...kernels.javascript import PRELUDE, literal, method, program
from ...kernels.lowering import NotScalarError, lowered
from ...model.ecu import Ecu
from ...model.effects import AbstractEffect, State
from ...model.parameters import NonNegative, Parameter, Positive, Scalar, parameters_of
from ...model.pid import Gains, Memory, tick
from ...model.refusals import refused
from ...model.rig_effects import number_of
from ...model.stepper import Step, step
from ...model.throttle import Throttle
from ...problem.problem import EstimationProblem
from ...problem.residual import equipped
from ...problem.trace import Trace
from ...run_folder.pid import ECU_KEYS

CHANNELS = ("position", "current", "emf", "motor_speed")
_MOVES = ("dt", "voltage0", "voltage1", "torque0", "torque1", "time", "mobile", "circuit", "plate", "series",
          "gear_ratio", "lower", "upper")  # fmt: skip
_FREE: dict[str, Any] = {"guide_stiffness": 0.0, "target0": 0.0, "target1": 0.0, "lever": 0.0}  # no guide
Types = tuple[type[AbstractEffect], ...]


@dataclass(frozen=True)
class Simulation:
    """The model of the page's simulation."""

    effects: Types  # printed effects of the throttle
    left_out: Types  # effects of the throttle that cannot be printed as JavaScript
    script: str  # JavaScript, see above


def simulation(result: FitResult) -> Simulation:
    """Print the throttle of a fitted model, without rig effects and without the ECU that drove it."""
    inside = body_types(result.free_parameters.layout)
    try:
        return Simulation(inside, (), script(inside))
    except (NotScalarError, NotWrittenError):
        out = refused(inside, program)
        if not out:
            raise
        kept = tuple(t for t in inside if t not in out)
        return Simulation(kept, out, script(kept))


def script(types: Types) -> str:
    """JavaScript of a throttle of these effects and of the ECU.

    Raises:
        NotScalarError, NotWrittenError: an effect cannot be printed as JavaScript.
    """
    begins = ", ".join(literal(float(start)) for effect in types for start in effect.z0)
    return "\n".join((
        '"use strict";',
        "/* Printed by etcfit from its own stepper, effects, sensors and PID: see etcfit/reporting/interactive. */",
        "(function (etcfit) {",
        PRELUDE,
        f"etcfit.model = {{\nz0: [{begins}],", *_plant(types), "};",
        f"etcfit.ecu = {{\nmemories: {len(Memory._fields)},", *_ecu(), "};",
        "})(globalThis.etcfit ??= {});\n",
    ))  # fmt: skip


def _plant(types: Types) -> tuple[str, ...]:
    symbols = [p.symbol for effect in types for p in parameters_of(effect)]
    memories = sum(len(effect.z0) for effect in types)
    names = (
        {symbol: f"p.{symbol}" for symbol in symbols},
        (State("x[0]", "x[1]", "x[2]"), tuple(f"x[{3 + k}]" for k in range(memories))),
        {name: f"u.{name}" for name in _MOVES},
    )

    def advance(p: Any, x: tuple[State, Any], u: Any) -> Any:
        state, memories = x
        return step(Throttle.build(types, p), state, memories, Step(**u, **_FREE))

    def first(p: Any, x: tuple[State, Any], u: Any) -> Any:
        return [0.0 + each for each in Throttle.build(types, p).first(x[0], Step(**u, **_FREE).inputs(0.0))]

    def read(p: Any, x: tuple[State, Any], u: Any) -> Any:
        state, memories = x
        seen = Throttle.build(types, p).observe(state, memories, Step(**u, **_FREE).inputs(1.0))
        return [seen[channel] for channel in CHANNELS]

    def delays(p: Any) -> Any:
        late = Throttle.build(types, p).delays()
        return [0.0 + each for each in (late.input, late.channels["position"], late.channels["current"])]

    return (
        _method("advance", "pxu", advance, names),
        _method("first", "pxu", first, names),
        _method("read", "pxu", read, names),
        _method("delays", "p", delays, names[:1]),
    )


def _ecu() -> tuple[str, ...]:
    gains = Gains(*(f"gains.{name}" for name in Gains._fields))  # pyright: ignore[reportArgumentType]
    ecu = Ecu(*(f"ecu.{name}" for name in Ecu._fields))  # pyright: ignore[reportArgumentType]
    memory = Memory(*(f"memory[{k}]" for k in range(len(Memory._fields))))
    sees = ("sees.wanted", "sees.position", "sees.ahead")

    def ticks(gains: Gains, ecu: Ecu, memory: Memory, wanted: Scalar, position: Scalar, ahead: Scalar) -> Any:
        volts, after = tick(gains, ecu, memory, wanted, position, ahead)
        return after, volts

    return (
        _method("begin", ("gains", "ecu", "angle"), Memory.at_rest, (gains, ecu, "angle")),
        _method("tick", ("gains", "ecu", "memory", "sees"), ticks, (gains, ecu, memory, *sees)),
        _method("lag", ("steps", "sees"), lagging, ("sees.shown", "sees.before", "sees.now", "steps")),
    )


def _method(name: str, arguments: Sequence[str], function: Callable[..., Any], names: Any) -> str:
    """A function of JAX as a method; `names` is its arguments with each number's JavaScript in its place."""
    graph = Graph()
    nodes = jax.tree.leaves(lowered(function, graph, jax.tree.map(graph.input, names)))
    return method(name, arguments, graph, nodes)


_FACTOR = 4.0  # a slider goes from a quarter of a positive value to four times it
_SPAN = 2.0  # or as many times the larger of value and typical size away from it


def plant_json(result: FitResult, simulated: Simulation) -> dict[str, Any]:
    """Names of effects, values in SI by symbol, ties, and the sliders.

    Args:
        simulated: its throttle in the page's simulation, without effects of the rig (see `excitation`) and without an
            ECU in the model.
    """
    layout = result.free_parameters.layout
    shown = dict.fromkeys(p.symbol for t in simulated.effects for p in parameters_of(t))
    ties = {symbol: other for symbol, other in layout.ties if symbol in shown}
    inside = {*simulated.effects, *simulated.left_out}
    return {
        "effects": [t.name for t in simulated.effects],
        "left_out": [t.name for t in simulated.left_out],
        "others": [t.name for t in layout.types if t not in inside],
        "values": {symbol: float(result.values[symbol]) for symbol in shown},
        "ties": ties,
        "sliders": [
            _slider(layout.parameter(s), float(result.values[s]), layout.status(s)) for s in shown if s not in ties
        ],
    }


def _slider(parameter: Parameter, value: float, status: str) -> dict[str, Any]:
    domain = parameter.domain
    geometric = isinstance(domain, Positive) or (isinstance(domain, NonNegative) and value > 0.05 * domain.scale)
    reach = _SPAN * max(abs(value), 0.5 * domain.scale)
    low, high = (value / _FACTOR, value * _FACTOR) if geometric else (value - reach, value + reach)
    if isinstance(domain, NonNegative):
        low = max(low, 0.0)
    return {
        "symbol": parameter.symbol,
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "value": value,
        "low": low,
        "high": high,
        "geometric": geometric,
        "status": status,
    }


_GAIN_FACTOR = 8.0  # a slider goes from an eighth of a gain to eight times it


def loop_json(result: FitResult, pid: Mapping[str, Any]) -> dict[str, Any] | None:
    """Gains, ECU, setpoint and levels; None without gains, or if an older file lacks their conditions."""
    needed = {"gains", "ecu", "setpoint", *(("bias_curve",) if pid.get("feed_forward") else ())}
    if not needed <= pid.keys():
        return None
    config, first = result.rig.config, trapezoid()
    lower, upper = config.stops
    curve = pid["bias_curve"] if pid.get("feed_forward") else None  # bias curve of the design
    bias = None if curve is None else {"angles": curve["angles_rad"], "volts": curve["hold_V"]}
    gains = {name: float(pid["gains"][name]) for name in ("Kp", "Ki", "Kd")}
    sliders = {name: {"value": value, "low": value / _GAIN_FACTOR, "high": value * _GAIN_FACTOR or 1.0,
                      "geometric": value > 0.0} for name, value in gains.items()}  # fmt: skip
    body = {"gear_ratio": float(config.gear_ratio), "lower": float(lower), "upper": float(upper)}
    return {
        "rule": pid["rule"],
        "gains": sliders,
        "unit": pid["gains"]["unit"],
        "ecu": ecu_json(pid["ecu"]),
        "body": body,
        "longest_step": LoopSettings().longest_step,
        "setpoint": {"times": pid["setpoint"]["times_s"], "shares": pid["setpoint"]["shares_of_travel"]},
        "first": first.duration,
        "levels": [
            {"begins": each.begins, "ends": each.ends, "before": each.before, "after": each.after}
            for each in first.levels
        ],
        "requirements": pid["requirements"],
        "bias": bias,
        "sliding": _sliding(pid.get("feed_forward_terms") or {}),
        "noise": float(pid["ecu"].get("noise_rad") or 0.0),
    }


def ecu_json(written: Mapping[str, Any]) -> dict[str, float]:
    """Fields of `Ecu` from the object `ecu` of pid.json, where null is 0; what older files lack has its default."""
    every = {field: written.get(ECU_KEYS.get(field, field), default) for field, default in Ecu()._asdict().items()}
    return {field: float(value or 0.0) for field, value in every.items() if field not in ("noise", "compensated")}


def _sliding(ahead: Mapping[str, Any]) -> dict[str, float] | None:
    """Feed-forward by the setpoint's rate, as in `Sliding`; None if the design had none."""
    terms = {term: term in ahead.get("terms", ()) for term in ("friction", "rate")}
    if not any(terms.values()):
        return None
    friction = ahead["friction"]
    return {
        "opening": friction["opening_V"] if terms["friction"] else 0.0,
        "closing": friction["closing_V"] if terms["friction"] else 0.0,
        "full": friction["full_from_rad_per_s"],
        "slope": ahead["rate"]["V_s_per_rad"] if terms["rate"] else 0.0,
    }


_FINEST = 1e-5  # allowed error of the corners, a share of the input's span, if there is space for all corners
_CHANNELS = ("current", "position", "emf", "motor_speed")


@dataclass(frozen=True, eq=False)
class Excitation:
    """The input and circuit of one trace, SI."""

    # time, level: corners of the input, s and V (N m for a torque), shape (K,); a jump has two at one instant
    time: np.ndarray
    level: np.ndarray
    within: float  # largest error of the input, unit of the level
    boundary: Mapping[str, float]  # circuit, plate, series resistance, gear ratio and stops, by the stepper's names
    start: tuple[float, float, float]  # current (A), angle (rad), speed (rad/s)
    release: float  # release of a held plate, s; infinite if never
    readings: Mapping[str, tuple[float, float]]  # gain and zero of each logged channel, if they are not 1 and 0
    lacks: tuple[str, ...]  # what the page's simulation leaves out of this trace, in words


def excitations(problem: EstimationProblem, x: np.ndarray, most: int) -> list[Excitation | str]:
    """Excitation of every trace of a problem at x, shape (P,), with at most so many corners; a sentence if
    impossible."""
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
    lines = {name: line for name, line in readings.items() if line is not None and line != (1.0, 0.0)}
    boundary = {name: float(steps[name][-1]) for name in fixed}
    i, theta, omega = start
    return Excitation(t[kept], level[kept], within, boundary, (i, theta, omega), release, lines, tuple(lacks))


def _polyline(time: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of an input that is linear in each step; the first step has no length."""
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
    """Gain and zero of each logged channel in a trace; None if the relation is not linear."""

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
