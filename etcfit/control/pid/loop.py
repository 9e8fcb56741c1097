"""Simulates the ECU in closed loop with the fitted nonlinear plant, for many gains and many draws of the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...backend import compiled_quickly
from ...model.ecu import Ecu
from ...model.effects import Inputs, State
from ...model.linear import MIDDLE, TransferFunction, coefficients, sensor_lag
from ...model.parameters import Scalar
from ...model.pid import Gains, Memory, tick
from ...model.stepper import step
from ...model.tangents import fusion_barrier
from ...model.throttle import Throttle
from ...problem.cores import CORES, side_by_side
from ..loop_figures import Demand, LoopFigures, Ran, add_to_tally, of_tally, tally, with_heat
from ..motion import free_step
from ..setpoint import Setpoint
from ..settings import LoopSettings
from .feedforward import Bias, HoldingVoltages, Sliding, hold_curve, rates
from .loop_kernel import kernel_of


class Body(NamedTuple):
    """The numbers of the rig that the loop needs: gear ratio, stops (rad)."""

    gear_ratio: float
    lower: float
    upper: float

    def share(self, angle: Any) -> Any:
        """Share of the travel at an angle, rad."""
        share = angle - self.lower
        share /= self.upper - self.lower  # in place, where it is an array
        return share


class Path(NamedTuple):
    """A response at each tick of the ECU, shape (..., K): position (rad), voltage (V), current (A)."""

    position: Any
    voltage: Any
    current: Any


class Tried(NamedTuple):
    """Responses and their figures."""

    share: np.ndarray  # position at each tick, share of the travel, shape (D, G, K)
    figures: LoopFigures  # shape (D, G) each


class _Carry(NamedTuple):
    """The state of the simulation between ticks: the plant, memories of its effects and of the controller."""

    x: State
    z: tuple[Scalar, ...]
    shown: Scalar  # position at the ECU's converter, rad
    memory: Any
    sent: Any  # output voltages of the last ticks, newest first, V
    tally: Any  # of the figures, where they are computed tick by tick


_LATEST = 64  # most ticks of delay
_UNROLLED = 4  # most integration steps of a tick that are unrolled: fast to run, and fast to compile

Controller = Callable[[Any, Ecu, Any, Scalar, Scalar, Scalar], Any]
Keep = Callable[[Path, Any], Any]  # from a tick's path and the controller's memory after it to the values that are kept


class Tallied(NamedTuple):
    """A way to reduce a response to some numbers tick by tick, so that little or nothing of it is stored."""

    keep: Keep  # what is stored all the same
    begin: Callable[[], Any]  # the numbers before the first tick
    # from the numbers before, a tick's path, the run and what is judged at this tick to the numbers after it
    add: Callable[[Any, Path, Any, Any], Any]


def _path(path: Path, memory: Any) -> Path:
    return path


def _figures_of(before: Any, path: Path, run: _Run, at: Demand) -> Any:
    ran = Ran(run.body.share(path.position), path.voltage / run.ecu.supply, path.current)
    return add_to_tally(jnp, before, at, ran)


_FIGURES = Tallied(lambda path, memory: (), tally, _figures_of)
_FIGURES_AND_POSITION = Tallied(lambda path, memory: path.position, tally, _figures_of)


def _acting(late: Scalar, parts: int, room: int) -> Any:
    """Share of each part of a tick in which each voltage acts, newest voltage first, shape (parts, room).

    Args:
        late: delay from the computation of a voltage to its action, ticks; it then acts for one tick.
        parts: number of parts, of equal duration.
        room: number of stored voltages; the oldest replaces all before it.
    """
    begins = late - np.arange(room)[None, :]
    ends = begins + 1.0
    begins = jnp.where(np.arange(room)[None, :] == room - 1, -jnp.inf, begins)
    k = np.arange(parts)[:, None] / parts
    return parts * jnp.maximum(jnp.minimum(ends, k + 1.0 / parts) - jnp.maximum(begins, k), 0.0)


class _Run(NamedTuple):
    """The data of a simulation that are common to all plants."""

    settings: Any  # of the controller
    first: Any  # initial memory, shape (G,)
    ecu: Ecu  # limits and clock
    body: Body  # gear ratio and stops
    wanted: Any  # setpoint at each tick, rad, shape (K,); or the demand of another kind of controller, see `Loop.run`
    bias: Any  # feed-forward at each tick, V, shape (K,)
    start: State  # initial state
    judged: Any = ()  # what is judged at each tick, entries of shape (K,), where the response is tallied


class _Plant(NamedTuple):
    """One plant and its supply and sensor noise."""

    throttle: Throttle  # the model
    drive: Scalar  # actual voltage over the voltage that the ECU commands
    ceiling: (
        Scalar  # largest voltage that the ECU can command, V: that of the supply where the ECU allows for the supply
    )
    misread: Any  # noise of each reading, rad, shape (K,)


def lagging(shown: Scalar, before: Scalar, now: Scalar, steps: Scalar) -> Scalar:
    """A first-order lag over a step in which its input changes linearly from before to now.

    Args:
        shown: its output at the begin of the step.
        before, now: its input.
        steps: duration of the step over its time constant; infinite for none.
    """
    behind = (now - before) / steps
    return now - behind + (shown - before + behind) * jnp.exp(-steps)


class _Simulation(NamedTuple):
    """The initial state of a run, and the function of one tick: from the state and the tick's (setpoint, feed-forward,
    what is judged, instant, noise) to the next state and the values that are kept."""

    begin: _Carry
    advance: Callable[[_Carry, Any], tuple[_Carry, Any]]


def _simulation(
    control: Controller, keep: Keep | Tallied, plant: _Plant, run: _Run, parts: int, room: int
) -> _Simulation:
    """One plant under one controller.

    Args:
        parts: number of integration steps in a tick.
        room: number of ticks of delay that are stored.
    """
    settings, first, ecu, body, _, _, start, _ = run
    throttle, drive, ceiling, _ = plant
    late = (ecu.delay + throttle.delays().input) / ecu.period
    seen_with = Inputs(0.0, 0.0, 0.0, 1.0, 0.0, body.gear_ratio, body.lower, body.upper)
    dt = ecu.period / parts
    acting = _acting(late, parts, room)
    steps = dt / jnp.where(ecu.lag > 0.0, ecu.lag, 0.0)

    def seen(x: State, z: Any, volts: Scalar, time: Scalar) -> Scalar:
        return throttle.observe(x, z, seen_with._replace(voltage=volts, time=time))["position"]

    def advance(carry: _Carry, entry: Any) -> tuple[_Carry, Any]:
        wanted, ahead, judged, time, error = entry
        volts, memory = fusion_barrier(
            control(settings, ecu, carry.memory, wanted, fusion_barrier(carry.shown + error), ahead)
        )
        volts = jnp.clip(volts, -ceiling, ceiling)
        sent = jnp.concatenate((jnp.asarray(volts)[None], carry.sent[:-1]))

        def part(state: Any, each: Any) -> Any:
            (x, z, shown), (k, shares) = state, each
            mean = drive * jnp.sum(shares * sent)
            end = time + (k + 1.0) * dt
            before = seen(x, z, drive * volts, end - dt)
            x, z = fusion_barrier(step(throttle, x, z, free_step(body, dt, fusion_barrier(mean), end)))
            return (x, z, lagging(shown, before, seen(x, z, drive * volts, end), steps)), None

        begin = (carry.x, carry.z, carry.shown)
        each = jnp.arange(float(parts)), acting
        (x, z, shown), _ = jax.lax.scan(part, begin, each, unroll=min(parts, _UNROLLED))
        path = Path(carry.x.theta, volts, carry.x.i)
        numbers = keep.add(carry.tally, path, run, judged) if isinstance(keep, Tallied) else ()
        kept = (keep.keep if isinstance(keep, Tallied) else keep)(path, memory)
        return _Carry(x, z, shown, memory, sent, numbers), kept

    x = State(*(jnp.asarray(each, dtype=float) for each in start))
    z = tuple(jnp.asarray(each, dtype=float) for each in throttle.z0)
    tallied = jax.tree.map(jnp.asarray, keep.begin()) if isinstance(keep, Tallied) else ()
    return _Simulation(_Carry(x, z, seen(x, z, 0.0, 0.0), first, jnp.zeros(room), tallied), advance)


def _each(control: Controller, keep: Keep | Tallied, parts: int, room: int, plants: _Plant, run: _Run) -> Any:
    """Every plant (D) under every controller (G), whose settings and memories have shape (G,): the kept values, shape
    (D, G, K), and the tally, shape (D, G)."""
    time = run.ecu.period * jnp.arange(run.bias.shape[0])

    def each(plant: _Plant, settings: Any, first: Any, wanted: Any) -> Any:
        own = run._replace(settings=settings, first=first)
        begin, advance = _simulation(control, keep, plant, own, parts, room)
        end, kept = jax.lax.scan(advance, begin, (wanted, run.bias, run.judged, time, plant.misread))
        return kept, end.tally

    each_its_own = 0 if jnp.ndim(jax.tree.leaves(run.wanted)[0]) > 1 else None
    over_gains = jax.vmap(each, in_axes=(None, 0, 0, each_its_own))
    return jax.vmap(over_gains, in_axes=(0, None, None, None))(plants, run.settings, run.first, run.wanted)


_many = jax.jit(_each, static_argnums=(0, 1, 2, 3))


@compiled_quickly
def _linear(throttles: Throttle, theta: Scalar, body: Body) -> Any:
    """Coefficients (D, 4), delay (D,) and sensor lag (D,)."""

    def each(throttle: Throttle) -> Any:
        late = jnp.asarray(throttle.delays().input, dtype=float)
        return coefficients(throttle, theta, *body), late, jnp.asarray(sensor_lag(throttle), dtype=float)

    return jax.vmap(each)(throttles)


@compiled_quickly
def _late(throttles: Throttle) -> Any:
    """Delay of each model's input, s, shape (D,)."""
    return jax.vmap(lambda throttle: jnp.asarray(throttle.delays().input, dtype=float))(throttles)


_AT_ONCE = 8  # models in one call of a compiled function, whatever their number, so that one program serves all


def _some_at_a_time(function: Callable[..., Any], throttles: Throttle, *common: Any) -> Any:
    """A function of models as a tree of arrays, shape (D, ...); the last model is repeated to fill up."""
    count = int(np.shape(jax.tree.leaves(throttles)[0])[0])
    chosen = (np.minimum(np.arange(k, k + _AT_ONCE), count - 1) for k in range(0, count, _AT_ONCE))
    parts = [function(jax.tree.map(lambda leaf, some=some: np.asarray(leaf)[some], throttles), *common)
             for some in chosen]  # fmt: skip
    return jax.tree.map(lambda *each: np.concatenate(each)[:count], *parts)


@dataclass(frozen=True, eq=False)
class Loop:
    """An ECU in closed loop with draws of a throttle body."""

    throttles: Throttle  # models, parameters of shape (D,); the nominal one first
    body: Body  # of the rig
    ecu: Ecu  # the controller
    bias: Bias | None = None  # feed-forward; None for none
    settings: LoopSettings = LoopSettings()  # of the simulation
    # actual voltage of each plant over the voltage that the ECU commands, shape (D,); None for 1. Where the output is a
    # duty it is the actual supply over the supply that the ECU assumes
    drive: np.ndarray | None = None
    sliding: Sliding | None = None  # feed-forward that follows the setpoint's rate; None for none
    # largest voltage that the ECU can command for each plant, V, shape (D,); None for no limit but its own
    ceiling: np.ndarray | None = None

    @property
    def draws(self) -> int:
        """D."""
        return int(np.shape(jax.tree.leaves(self.throttles)[0])[0])

    def first(self, count: int) -> Loop:
        """The loop with the first `count` models only, the nominal one first."""
        return self.taking(np.arange(min(count, self.draws)))

    def taking(self, which: np.ndarray) -> Loop:
        """The loop with some of the models, by their numbers, shape (C,)."""
        drive, ceiling = (None if each is None else each[which] for each in (self.drive, self.ceiling))
        # by NumPy: a look-up by JAX takes a millisecond for each parameter
        throttles = jax.tree.map(lambda leaf: np.asarray(leaf)[which], self.throttles)
        return replace(self, throttles=throttles, drive=drive, ceiling=ceiling)

    def with_new_noise_seed(self) -> Loop:
        """The loop with a new noise seed: success must not be counted under the noise of the search."""
        return replace(self, settings=replace(self.settings, seed=self.settings.seed + 1))

    def under(self, ecu: Ecu) -> Loop:
        """The loop with another ECU and the same plants."""
        return replace(self, ecu=ecu)

    def angle(self, share: Any) -> Any:
        """Angle at a share of the travel, rad."""
        return self.body.lower + share * (self.body.upper - self.body.lower)

    def share(self, angle: Any) -> Any:
        """Share of the travel at an angle, rad."""
        return self.body.share(angle)

    def holds(self, angles: np.ndarray) -> HoldingVoltages:
        """Voltages that hold the nominal plate at these angles (rad), shape (K,)."""
        return hold_curve(self.nominal, angles, *self.body)

    def ahead(self, setpoint: np.ndarray) -> np.ndarray:
        """Feed-forward of the ECU at each tick, V, for setpoints (rad), shape (K,)."""
        volts = np.zeros_like(setpoint) if self.bias is None else self.bias.volts(setpoint)
        return volts if self.sliding is None else volts + self.sliding.volts(rates(setpoint, self.ecu))

    @property
    def nominal(self) -> Throttle:
        """The first model."""
        return jax.tree.map(lambda leaf: leaf[0], self.throttles)

    def linear(self, share: float = MIDDLE) -> TransferFunction:
        """The plants linearised about a share of the travel, rad/V: numbers of shape (D, 1)."""
        rows, delay, lag = _some_at_a_time(_linear, self.throttles, self.angle(share), self.body)
        b0, a2, a1, a0, delay, lag = (np.asarray(v)[:, None] for v in (*rows.T, delay, lag))
        return TransferFunction(b0 * self._driven[:, None], a2, a1, a0, delay, lag)  # pyright: ignore[reportArgumentType]

    def respond(self, gains: Gains, setpoint: Setpoint, keep: Keep | Tallied = _path) -> Any:
        """Responses to a setpoint, shape (D, G, K), of gains of shape (G,): a `Path`, or what `keep` makes of it."""
        gains = Gains(*(np.asarray(g, dtype=float) for g in gains))
        first = Memory.at_rest(gains, self.ecu, self.angle(setpoint.shares[0]))
        return self.run(tick, gains, first, setpoint, keep=keep)

    def run(
        self,
        control: Controller,
        settings: Any,
        first: Any,
        setpoint: Setpoint,
        start: State | None = None,
        keep: Keep | Tallied = _path,
        reduced: Callable[[Any], Any] = lambda kept: kept,
        demand: Any = None,
    ) -> Any:
        """Responses to a setpoint, shape (D, G, K), of any controller: a `Path`, or the values that `keep` takes of it;
        where it tallies them, also the numbers after the last tick, shape (D, G).

        Args:
            control: as `ecu.tick`: settings, ECU, memory, setpoint, position, bias -> voltage, memory.
            settings: settings of the controller, entries of shape (G,).
            first: initial memory of the controller, entries of shape () or (G,).
            start: initial state of every plant; None: at rest at the first value of the setpoint.
            keep: function of a tick's path and the controller's memory after it; its values are returned.
            reduced: function of these values, shape (..., K), whose result is returned instead, shape (...).
            demand: input of each controller in place of the setpoint, entries of shape (G, K).
        """
        time = setpoint.instants(self.ecu.period)
        wanted = self.angle(setpoint.at(time))
        tallied = isinstance(keep, Tallied)
        judged = Demand.of_setpoint(setpoint, time, setpoint.levels, setpoint.stretches) if tallied else ()
        ahead = self.ahead(wanted)
        start = State(0.0, self.angle(setpoint.shares[0]), 0.0) if start is None else start
        shape = np.shape(jax.tree.leaves(settings)[0])
        first = jax.tree.map(lambda leaf: np.broadcast_to(np.asarray(leaf, dtype=float), shape), first)
        parts = max(1, math.ceil(self.ecu.period / self.settings.longest_step - 1e-9))
        run = _Run(settings, first, self.ecu, self.body, wanted if demand is None else demand, ahead, start, judged)
        rng = np.random.default_rng(self.settings.seed)
        misread = self.ecu.noise * rng.standard_normal((self.draws, wanted.size))
        ceiling = np.full(self.draws, np.inf) if self.ceiling is None else self.ceiling
        plants, room = _Plant(self.throttles, self._driven, ceiling, misread), self._room()
        kernel = kernel_of(_simulation, control, keep, parts, room, plants, run)
        if kernel is not None:
            kept, numbers = kernel.run(plants, run, reduced)
        else:
            share = self.draws // CORES if self.draws % CORES == 0 else self.draws
            pieces = [jax.tree.map(lambda leaf, k=k: leaf[k : k + share], plants) for k in range(0, self.draws, share)]
            paths = side_by_side(lambda piece: _many(control, keep, parts, room, piece, run), pieces)
            kept, numbers = jax.tree.map(lambda *each: np.concatenate(each), *paths)
            kept = reduced(kept)
        return (kept, numbers) if tallied else kept

    @property
    def _driven(self) -> np.ndarray:
        return np.ones(self.draws) if self.drive is None else self.drive

    def tried(self, gains: Gains, setpoint: Setpoint) -> Tried:
        """Responses to a setpoint, and all their figures."""
        position, numbers = self.respond(gains, setpoint, _FIGURES_AND_POSITION)
        return Tried(self.share(np.array(position)), self._with_heat(of_tally(numbers, setpoint)))

    def figures(self, gains: Gains, setpoint: Setpoint) -> LoopFigures:
        """The same figures, shape (D, G) each, without the responses."""
        return self._with_heat(of_tally(self.respond(gains, setpoint, _FIGURES)[1], setpoint))

    def _with_heat(self, figures: LoopFigures) -> LoopFigures:
        return with_heat(figures, np.asarray(self.throttles.parameter("R_a"))[:, None], self.settings.bridge_ohm)

    def _room(self) -> int:
        """Number of ticks of delay to store: a power of two, so that loops of similar delays share a compiled
        program."""
        ticks = (float(np.max(_some_at_a_time(_late, self.throttles))) + self.ecu.delay) / self.ecu.period
        return min(_LATEST, 1 << math.ceil(math.log2(ticks + 2.0))) if ticks > 0.0 else 1
