"""The plant as straight-line C: the model's own stepper, traced and printed.

Nothing of the physics is written a second time. What is traced is `stepper.step`, the same function that fits and
designs: dry friction as a set-valued law inside each implicit stage, stops, preload, memories and all effects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax

from ..errors import UsageError
from ..kernels.c import program
from ..kernels.graph import Graph
from ..kernels.infix import Program
from ..kernels.lowering import NotScalarError, lowered
from ..model.effects import AbstractEffect, Inputs, State
from ..model.parameters import Scalar
from ..model.refusals import refused
from ..model.stepper import Step, step
from ..model.throttle import Throttle
from .base import Source

BODY: Mapping[str, tuple[str, str]] = {
    "N": ("1", "gear ratio, motor angle over plate angle"),
    "lower": ("rad", "closed stop"),
    "upper": ("rad", "open stop"),
}
_SENSOR: Mapping[str, tuple[str, str]] = {
    "sensor_closed_V": ("V", "of the position sensor at angle 0, [tps] of rig.toml"),
    "sensor_slope": ("V/rad", "of the position sensor, [tps] of rig.toml"),
}
_STATE = ("i", "theta", "omega")


@dataclass(frozen=True)
class Quantity:
    """A parameter of the plant.

    Args:
        symbol, unit, meaning: see `model.parameters.Parameter`.
        value: as fitted, SI.
    """

    symbol: str
    unit: str
    meaning: str
    value: float


@dataclass(frozen=True)
class Memory:
    """What an effect remembers.

    Args:
        effect: its name.
        start: where a run begins.
    """

    effect: str
    start: float


@dataclass(frozen=True)
class Late:
    """Delays, in steps.

    Args:
        program: of the delays of voltage, sensed angle and sensed current.
        lines: which of these three there are.
        room: samples that a delay line keeps.
    """

    program: Program
    lines: tuple[bool, bool, bool]
    room: int


@dataclass(frozen=True)
class Plant:
    """A fitted model as straight-line C.

    Args:
        step: s.
        quantities: parameters, those of the rig at the end.
        memories: of the effects.
        advance: state and memories after a step, in the order of `names`.
        read: sensed angle (rad) and sensed current (A).
        late: delays; None where the model has none.
        sensor: whether the position sensor's volts are known.
    """

    step: float
    quantities: tuple[Quantity, ...]
    memories: tuple[Memory, ...]
    advance: Program
    read: Program
    late: Late | None
    sensor: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Of state and memories, as C has them."""
        return (*_STATE, *(f"z{k}" for k in range(len(self.memories))))

    @property
    def calls(self) -> frozenset[str]:
        """Functions that the C calls."""
        return self.advance.calls | self.read.calls | (self.late.program.calls if self.late else frozenset())


def plant_of(source: Source) -> Plant:
    """Trace a model's stepper.

    Raises:
        UsageError: an effect computes what straight-line C cannot.
    """
    h, quantities = source.settings.step, _quantities(source)
    symbols = [each.symbol for each in quantities]

    def traced(function: Callable[..., Any]) -> tuple[Graph, list[int]]:
        graph = Graph()
        values = {symbol: graph.input(f"p->{symbol}") for symbol in symbols}
        x, z = State(*map(graph.input, _STATE)), tuple(graph.input(f"z{k}") for k in range(len(memories)))
        rest = [graph.input(name) for name in ("voltage", "torque", "time")]
        return graph, jax.tree.leaves(lowered(function, graph, (values, x, z, *rest)))

    memories = tuple(Memory(effect.name, float(start)) for effect in source.effects for start in effect.z0)
    try:
        advance = program(*traced(advancing(source.effects, h)))
        read = program(*traced(_reading(source.effects)))
        late = _late(*traced(_delays(source.effects)), source)
    except NotScalarError as error:
        raise UsageError(_refusal(source, str(error))) from None
    return Plant(h, quantities, memories, advance, read, late, source.fitted.config.tps is not None)


def _quantities(source: Source) -> tuple[Quantity, ...]:
    values = source.values
    ties = dict(source.fitted.free_parameters.layout.ties)
    own = [
        Quantity(p.symbol, p.unit, p.meaning + (f", tied to {ties[p.symbol]}" if p.symbol in ties else ""),
                 values[p.symbol])
        for p in source.parameters
    ]  # fmt: skip
    known, kinds = dict(source.body), dict(BODY)
    if (tps := source.fitted.config.tps) is not None:
        known |= {"sensor_closed_V": tps.closed_V, "sensor_slope": (tps.open_V - tps.closed_V) / tps.travel}
        kinds |= _SENSOR
    return (*own, *(Quantity(symbol, *kinds[symbol], value) for symbol, value in known.items()))


def advancing(effects: tuple[type[AbstractEffect], ...], h: float) -> Callable[..., Any]:
    """State and memories after a step of h (s) under constant inputs, a function of parameters by symbol, state,
    memories, voltage (V), torque (N m) and the time at the step's begin (s)."""

    def advance(
        p: Mapping[str, Scalar], x: State, z: tuple[Scalar, ...], voltage: Scalar, torque: Scalar, time: Scalar
    ) -> Any:
        s = Step(dt=h, voltage0=voltage, voltage1=voltage, torque0=torque, torque1=torque, time=time + h, mobile=1.0,
                 circuit=1.0, plate=1.0, series=0.0, gear_ratio=p["N"], lower=p["lower"], upper=p["upper"],
                 guide_stiffness=0.0, target0=0.0, target1=0.0, lever=0.0)  # fmt: skip
        return step(Throttle.build(effects, p), x, z, s)

    return advance


def _inputs(p: Mapping[str, Scalar], voltage: Scalar, torque: Scalar, time: Scalar) -> Inputs:
    return Inputs(voltage, torque, time, 1.0, 0.0, p["N"], p["lower"], p["upper"])


def _reading(effects: tuple[type[AbstractEffect], ...]) -> Callable[..., Any]:
    def read(p: Any, x: State, z: Any, voltage: Scalar, torque: Scalar, time: Scalar) -> Any:
        seen = Throttle.build(effects, p).observe(x, z, _inputs(p, voltage, torque, time))
        return seen["position"], seen["current"]

    return read


def _delays(effects: tuple[type[AbstractEffect], ...]) -> Callable[..., Any]:
    def delays(p: Any, *_: Any) -> Any:
        late = Throttle.build(effects, p).delays()
        return tuple(0.0 + each for each in (late.input, late.channels["position"], late.channels["current"]))

    return delays


def _late(graph: Graph, delays: list[int], source: Source) -> Late | None:
    """The delays in steps, and room for twice what was fitted, so that a user may vary them."""
    lines = (graph.known(delays[0]) != 0.0, graph.known(delays[1]) != 0.0, graph.known(delays[2]) != 0.0)
    if not any(lines):
        return None
    h, now = graph.constant(source.settings.step), source.throttle.delays()
    longest = max(float(each) for each in (now.input, *now.channels.values()))
    in_steps = [graph.make("div", delay, h) for delay in delays]
    return Late(program(graph, in_steps), lines, 2 * math.ceil(longest / source.settings.step) + 8)


def _refusal(source: Source, primitive: str) -> str:
    """Which effect computes what straight-line C cannot."""
    culprits = [effect.name for effect in refused(source.effects, program)]
    return (f"{', '.join(culprits) or 'the model'}: its formula uses {primitive}, which is no arithmetic of single "
            "numbers, so that no C can be printed from it. Write the effect with scalar jax.numpy functions without "
            "loops, or teach etcfit/kernels/lowering.py that primitive.")  # fmt: skip
