"""The plant as straight-line C99, for hardware in the loop: the model's own stepper, traced and printed.

No physics is written a second time. The traced function is `stepper.step`, which fits and designs use too: dry friction
as a set-valued law inside each implicit stage, stops, preload, memories and all effects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from ..control.motion import free_step
from ..control.pid.loop import Body
from ..errors import UsageError
from ..kernels.c import program
from ..kernels.graph import Graph
from ..kernels.infix import Program
from ..kernels.lowering import NotScalarError, lowered
from ..model.effects import AbstractEffect, Inputs, State
from ..model.parameters import Scalar
from ..model.refusals import refused
from ..model.stepper import step
from ..model.throttle import Throttle
from .base import BODY, Export, Format, Source, rendered

_SENSOR: Mapping[str, tuple[str, str]] = {
    "sensor_closed_V": ("V", "of the position sensor at angle 0, [tps] of rig.toml"),
    "sensor_slope": ("V/rad", "of the position sensor, [tps] of rig.toml"),
}
_STATE = ("i", "theta", "omega")
_LEVELS = (0.0, 8.0, 3.0, 0.0, -6.0, 12.0, 5.0, -12.0, 6.5, 6.6, 6.4, 0.0)  # V, through stick, slip and both stops
_HOLD = 0.05  # duration of each level, s; two rows per level


class Quantity(NamedTuple):
    """A fitted parameter of the plant, see `model.parameters.Parameter`; its value in SI."""

    symbol: str
    unit: str
    meaning: str
    value: float


class Memory(NamedTuple):
    """A memory of an effect: the effect's name, and the initial value."""

    effect: str
    start: float


class Late(NamedTuple):
    """Delays, in steps."""

    program: Program  # computes the delays of voltage, sensed angle and sensed current
    lines: tuple[bool, bool, bool]  # whether each of these three exists
    room: int  # number of samples in a delay line


@dataclass(frozen=True)
class Plant:
    """A fitted model as straight-line C."""

    step: float  # s
    quantities: tuple[Quantity, ...]  # parameters, those of the rig at the end
    memories: tuple[Memory, ...]  # memories of the effects
    advance: Program  # state and memories after a step, in the order of `names`
    read: Program  # sensed angle (rad) and sensed current (A)
    late: Late | None  # delays; None if the model has none
    sensor: bool  # whether the position sensor's volts are known

    @property
    def names(self) -> tuple[str, ...]:
        """Names of state and memories in C."""
        return (*_STATE, *(f"z{k}" for k in range(len(self.memories))))

    @property
    def calls(self) -> frozenset[str]:
        """Functions that the C calls."""
        return self.advance.calls | self.read.calls | (self.late.program.calls if self.late else frozenset())


def plant_of(source: Source) -> Plant:
    """Trace a model's stepper.

    Raises:
        UsageError: an effect cannot be written as straight-line C.
    """
    h, effects, quantities = source.settings.step, source.effects, _quantities(source)
    memories = tuple(Memory(effect.name, float(start)) for effect in effects for start in effect.z0)

    def traced(function: Callable[..., Any]) -> tuple[Graph, list[int]]:
        graph = Graph()
        values = {each.symbol: graph.input(f"p->{each.symbol}") for each in quantities}
        x, z = State(*map(graph.input, _STATE)), tuple(graph.input(f"z{k}") for k in range(len(memories)))
        rest = [graph.input(name) for name in ("voltage", "torque", "time")]
        return graph, jax.tree.leaves(lowered(function, graph, (values, x, z, *rest)))

    def read(p: Any, x: State, z: Any, voltage: Scalar, torque: Scalar, time: Scalar) -> Any:
        inputs = Inputs(voltage, torque, time, 1.0, 0.0, p["N"], p["lower"], p["upper"])
        seen = Throttle.build(effects, p).observe(x, z, inputs)
        return seen["position"], seen["current"]

    def delays(p: Any, *_: Any) -> Any:
        late = Throttle.build(effects, p).delays()
        return tuple(0.0 + each for each in (late.input, late.channels["position"], late.channels["current"]))

    try:
        advance, seen, late = (
            program(*traced(advancing(effects, h))),
            program(*traced(read)),
            _late(*traced(delays), source),
        )
    except NotScalarError as error:
        culprits = ", ".join(effect.name for effect in refused(effects, program))
        raise UsageError(f"{culprits or 'the model'}: its formula uses {error}, which is no arithmetic of single "
                         "numbers, so that no C can be printed from it. Write the effect with scalar jax.numpy "
                         "functions without loops, or teach etcfit/kernels/lowering.py that primitive."
                         ) from None  # fmt: skip
    return Plant(h, quantities, memories, advance, seen, late, source.fitted.config.tps is not None)


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
        s = free_step(Body(p["N"], p["lower"], p["upper"]), h, voltage, time + h)
        s = s._replace(torque0=torque, torque1=torque)
        return step(Throttle.build(effects, p), x, z, s)

    return advance


def _late(graph: Graph, delays: list[int], source: Source) -> Late | None:
    """The delays in steps, with space for twice the fitted delays, so that a user may vary them."""
    lines = (graph.known(delays[0]) != 0.0, graph.known(delays[1]) != 0.0, graph.known(delays[2]) != 0.0)
    if not any(lines):
        return None
    h, now = graph.constant(source.settings.step), source.throttle.delays()
    longest = max(float(each) for each in (now.input, *now.channels.values()))
    in_steps = [graph.make("div", delay, h) for delay in delays]
    return Late(program(graph, in_steps), lines, 2 * math.ceil(longest / source.settings.step) + 8)


def c_files(source: Source, plant: Plant, cannot_hold: tuple[str, ...] = ()) -> dict[str, str]:
    """Header and source, by name."""
    parts = {"title": source.title, "plant": plant, "notes": (source.origin, *source.cautions, *cannot_hold)}
    return {f"etcfit_plant.{end}": rendered(f"plant.{end}", **parts) for end in ("h", "c")}


def c_cannot_hold(source: Source) -> Iterator[str]:
    """Sentences on differences between the C and the rig."""
    yield (f"The step is fixed at {source.settings.step:g} s and the voltage is constant over it: average a PWM "
           "over each step.")  # fmt: skip
    yield "Noise of the sensors is not in it."
    if source.fitted.config.tps is None:
        yield "The position sensor's volts are not in it: rig.toml has no [tps]."


def _reference(source: Source) -> tuple[list[tuple[float, ...]], int]:
    """Voltage, current, angle and speed of a simulation by our own stepper from the closed stop, and steps per row."""
    h, effects = source.settings.step, source.effects
    steps = max(1, round(_HOLD / h))
    volts = np.repeat(_LEVELS, 2 * steps)
    parameters = {**source.values, **source.body}
    late = float(source.throttle.delays().input) / h
    whole = int(late)
    padded = np.concatenate((np.zeros(whole + 1), volts))
    acting = padded[1 : volts.size + 1] + (late - whole) * (padded[: volts.size] - padded[1 : volts.size + 1])
    advance = advancing(effects, h)

    @jax.jit
    def run(acting: jax.Array) -> State:
        def one(carry: Any, volt: jax.Array) -> Any:
            x, z, time = carry
            x, z = advance(parameters, x, z, volt, 0.0, time)
            return (x, z, time + h), x

        z = tuple(jax.numpy.asarray(float(start)) for effect in effects for start in effect.z0)
        x = State(*(jax.numpy.asarray(each) for each in (0.0, parameters["lower"], 0.0)))
        return jax.lax.scan(one, (x, z, jax.numpy.zeros(())), acting)[1]

    path = run(jax.numpy.asarray(acting))
    ends = np.arange(steps - 1, volts.size, steps)
    return [tuple(float(each[k]) for each in (volts, *path)) for k in ends], steps


def _export(source: Source) -> Export:
    plant, lost = plant_of(source), tuple(c_cannot_hold(source))
    rows, steps = _reference(source)
    test = rendered("plant_test.c", rows=rows, steps=steps, start=source.travel[0])
    return Export({**c_files(source, plant, lost), "etcfit_plant_test.c": test}, (*source.cautions, *lost))


C = Format("c", "C99 of the plant for hardware in the loop", _export)
