"""Model, ECU and setpoint as the page simulates them: values, sliders, JavaScript printed from the fit's functions.

    etcfit.model.advance(p, x, u, out)     state and memories after a step              stepper.step
    etcfit.model.read(p, x, u, out)        CHANNELS as their sensors show them          Throttle.observe
    etcfit.model.delays(p, out)            of input, position and current, s            Throttle.delays
    etcfit.ecu.begin(gains, ecu, angle, out)                memory of a PID at rest     Memory.at_rest
    etcfit.ecu.tick(gains, ecu, memory, sees, out)          memory and voltage after    ecu.tick
    etcfit.ecu.memories                                     how many numbers a PID remembers
    etcfit.ecu.lag(steps, sees, out)                        input filter of the ECU     loop.lagging

p: parameters (SI) by symbol; x: current, angle, speed and memories; u: fields of `Step` by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax

from ...control.pid.loop import lagging
from ...control.setpoint import trapezoid
from ...control.settings import LoopSettings
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
from ...model.rig_effects import AbstractRigEffect
from ...model.stepper import Step, step
from ...model.throttle import Throttle

CHANNELS = ("position", "current", "emf", "motor_speed")
_MOVES = ("dt", "voltage0", "voltage1", "torque0", "torque1", "time", "mobile", "circuit", "plate", "series",
          "gear_ratio", "lower", "upper")  # fmt: skip
_FREE: dict[str, Any] = {"guide_stiffness": 0.0, "target0": 0.0, "target1": 0.0, "lever": 0.0}  # no guide
Types = tuple[type[AbstractEffect], ...]


@dataclass(frozen=True)
class Simulation:
    """What the page simulates.

    Args:
        effects: of the throttle, printed.
        left_out: of the throttle, but no JavaScript can be printed from them.
        script: JavaScript, see above.
    """

    effects: Types
    left_out: Types
    script: str


def simulation(result: FitResult) -> Simulation:
    """Print the throttle of a fitted model: neither what stands between rig and log, nor an ECU that drove it."""
    types = result.free_parameters.layout.types
    inside = tuple(t for t in types if not issubclass(t, AbstractRigEffect) and not t.commands)
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
        NotScalarError, NotWrittenError: an effect computes what JavaScript printed from it cannot.
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

    def read(p: Any, x: tuple[State, Any], u: Any) -> Any:
        state, memories = x
        seen = Throttle.build(types, p).observe(state, memories, Step(**u, **_FREE).inputs(1.0))
        return [seen[channel] for channel in CHANNELS]

    def delays(p: Any) -> Any:
        late = Throttle.build(types, p).delays()
        return [0.0 + each for each in (late.input, late.channels["position"], late.channels["current"])]

    return (
        _method("advance", "pxu", advance, names),
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


_FACTOR = 4.0  # a slider goes from a fourth of a positive value to four times it
_SPAN = 2.0  # or as many times the larger of value and typical size away from it


def plant_json(result: FitResult, simulated: Simulation) -> dict[str, Any]:
    """Names of effects, values in SI by symbol, ties, and the sliders.

    Args:
        simulated: its throttle as the page simulates it; the others are effects of the rig, which stand between
            throttle and log (`excitation`), and an ECU in the model.
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
# fields of `Ecu` and their names in pid.json; null there is 0
_ECU = {"period": "period_s", "supply": "supply_V", "filter": "derivative_filter_s", "delay": "delay_s", "pwm": "pwm_V",
        "resolution": "resolution_rad", "duty": "duty_limit", "integral": "integral_limit", "lag": "input_filter_s",
        "slew": "slew_V_per_s", "dead_band": "dead_band_rad", "setpoint_weight": "setpoint_weight",
        "derivative_weight": "derivative_weight"}  # fmt: skip


def loop_json(result: FitResult, pid: Mapping[str, Any]) -> dict[str, Any] | None:
    """Gains, ECU, setpoint and levels; None where no gains were sought, or an older file lacks what they ran with."""
    needed = {"gains", "ecu", "setpoint", *(("bias_curve",) if pid.get("feed_forward") else ())}
    if not needed <= pid.keys():
        return None
    config, first = result.rig.config, trapezoid()
    lower, upper = config.stops
    curve = pid["bias_curve"] if pid.get("feed_forward") else None  # that the gains were found with
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
    """Fields of `Ecu` from the object `ecu` of pid.json; those of older files that are absent at their defaults."""
    default = Ecu()._asdict()
    return {
        field: float(written[name] or 0.0) if name in written else float(default[field]) for field, name in _ECU.items()
    }


def _sliding(ahead: Mapping[str, Any]) -> dict[str, float] | None:
    """What is put ahead by the setpoint's rate, as `Sliding` has it; None where the gains were found without."""
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
