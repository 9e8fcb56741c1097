"""The model as the page simulates it: JavaScript printed from the very functions by which etcfit fits and designs.

    etcfit.model.advance(p, x, u, out)     state and memories after a step              stepper.step
    etcfit.model.read(p, x, u, out)        CHANNELS as their sensors show them          Throttle.observe
    etcfit.model.delays(p, out)            of input, position and current, s            Throttle.delays
    etcfit.ecu.begin(gains, ecu, angle, out)                memory of a PID at rest     Memory.at_rest
    etcfit.ecu.tick(gains, ecu, memory, sees, out)          memory and voltage after    ecu.tick
    etcfit.ecu.lag(steps, sees, out)                        input filter of the ECU     loop.lagging

p: parameters (SI) by symbol; x: current, angle, speed and memories; u: fields of `Step` by name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax

from ...control.pid.ecu import Gains, Memory, tick
from ...control.pid.loop import lagging
from ...estimation.result import FitResult
from ...kernels.graph import Graph
from ...kernels.infix import NotWrittenError
from ...kernels.javascript import PRELUDE, literal, method, program
from ...kernels.lowering import NotScalarError, lowered
from ...model.ecu import Ecu
from ...model.effects import AbstractEffect, State
from ...model.parameters import Scalar, parameters_of
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
        "etcfit.ecu = {", *_ecu(), "};",
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
