"""The ECU closed around the fitted nonlinear plant, for many gains and many draws of the parameters at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.effects import Inputs, State
from ...model.linear import MIDDLE, TransferFunction, coefficients, sensor_lag
from ...model.parameters import Scalar
from ...model.stepper import Step, step
from ...model.throttle import Throttle
from ..settings import LoopSettings
from .ecu import Memory, tick
from .feedforward import Bias, HoldingVoltages, hold_curve
from .gains import Gains
from .response import Judged, judge
from .setpoint import Setpoint


class Body(NamedTuple):
    """What of the rig the loop needs: gear ratio, stops (rad)."""

    gear_ratio: float
    lower: float
    upper: float


class Path(NamedTuple):
    """A response at each tick of the ECU, shape (..., K): position (rad), voltage (V), current (A)."""

    position: Any
    voltage: Any
    current: Any


class _Carry(NamedTuple):
    """What the simulation hands from tick to tick: the plant, memories of its effects and of the controller."""

    x: State
    z: tuple[Scalar, ...]
    memory: Any
    sent: Any  # voltages of the last ticks, newest first, V


_UNROLLED = 4  # integration steps of a tick at most: quick to run, and quick to compile

Controller = Callable[[Any, Ecu, Any, Scalar, Scalar, Scalar], Any]


def _step(ecu: Ecu, body: Body, dt: Scalar, volts: Scalar, time: Scalar) -> Step:
    """One integration step of dt (s) under a constant voltage (V), the plate free between its stops."""
    return Step(dt=dt, voltage0=volts, voltage1=volts, torque0=0.0, torque1=0.0, time=time, mobile=1.0, circuit=1.0,
                plate=1.0, series=0.0, gear_ratio=body.gear_ratio, lower=body.lower, upper=body.upper,
                guide_stiffness=0.0, target0=0.0, target1=0.0, lever=0.0)  # fmt: skip


def _acting(sent: Any, begin: Scalar, end: Scalar) -> Scalar:
    """Mean voltage from begin to end, ticks since the newest was sent (at most one tick apart, none beyond 1), V."""
    newest = jnp.floor(begin)
    share = jnp.clip((newest + 1.0 - begin) / (end - begin), 0.0, 1.0)
    back = -newest.astype(int)
    return (
        share * sent[jnp.clip(back, 0, sent.shape[0] - 1)]
        + (1.0 - share) * sent[jnp.clip(back - 1, 0, sent.shape[0] - 1)]
    )


class _Run(NamedTuple):
    """What every plant is simulated with.

    Args:
        settings: of the controller.
        first: memory with which it begins, shape (G,).
        ecu: limits and clock.
        body: gear ratio and stops.
        setpoint: rad at each tick, shape (K,).
        bias: feed-forward at each tick, V, shape (K,).
        start: state at the begin.
    """

    settings: Any
    first: Any
    ecu: Ecu
    body: Body
    setpoint: Any
    bias: Any
    start: State


def _one(control: Controller, throttle: Throttle, run: _Run, parts: int, room: int) -> Path:
    """One plant under one controller.

    Args:
        control: see `Loop.run`.
        throttle: the plant.
        run: all else that is data.
        parts: integration steps in a tick.
        room: ticks of delay that are remembered.
    """
    settings, first, ecu, body, setpoint, bias, start = run
    late = (ecu.delay + throttle.delays().input) / ecu.period
    seen_with = Inputs(0.0, 0.0, 0.0, 1.0, 0.0, body.gear_ratio, body.lower, body.upper)

    def advance(carry: _Carry, entry: Any) -> tuple[_Carry, Path]:
        wanted, ahead, time = entry
        seen = throttle.observe(carry.x, carry.z, seen_with._replace(voltage=carry.sent[0], time=time))
        volts, memory = control(settings, ecu, carry.memory, wanted, seen["position"], ahead)
        sent = jnp.concatenate((volts[None], carry.sent[:-1]))

        def part(state: Any, k: Any) -> Any:
            x, z = state
            mean = _acting(sent, k / parts - late, (k + 1.0) / parts - late)
            s = _step(ecu, body, ecu.period / parts, mean, time + (k + 1.0) * ecu.period / parts)
            return step(throttle, x, z, s), None

        (x, z), _ = jax.lax.scan(part, (carry.x, carry.z), jnp.arange(parts, dtype=float), unroll=min(parts, _UNROLLED))
        return _Carry(x, z, memory, sent), Path(carry.x.theta, volts, carry.x.i)

    x = State(*(jnp.asarray(each, dtype=float) for each in start))
    z = tuple(jnp.asarray(each, dtype=float) for each in throttle.z0)
    time = ecu.period * jnp.arange(setpoint.shape[0])
    _, path = jax.lax.scan(advance, _Carry(x, z, first, jnp.zeros(room)), (setpoint, bias, time))
    return path


@partial(jax.jit, static_argnums=(0, 3, 4))
def _many(control: Controller, throttles: Throttle, run: _Run, parts: int, room: int) -> Path:
    """Every plant (D) under every controller (G), whose settings and memories have shape (G,): shape (D, G, K)."""

    def each(throttle: Throttle, settings: Any, first: Any) -> Path:
        return _one(control, throttle, run._replace(settings=settings, first=first), parts, room)

    over_gains = jax.vmap(each, in_axes=(None, 0, 0))
    return jax.vmap(over_gains, in_axes=(0, None, None))(throttles, run.settings, run.first)


@jax.jit
def _linear(throttles: Throttle, theta: Scalar, body: Body) -> Any:
    """Coefficients (D, 4), delay (D,) and sensor lag (D,)."""

    def each(throttle: Throttle) -> Any:
        late = jnp.asarray(throttle.delays().input, dtype=float)
        return coefficients(throttle, theta, *body), late, jnp.asarray(sensor_lag(throttle), dtype=float)

    return jax.vmap(each)(throttles)


@jax.jit
def _late(throttles: Throttle) -> Any:
    """Delay of each model's input, s, shape (D,)."""
    return jax.vmap(lambda throttle: jnp.asarray(throttle.delays().input, dtype=float))(throttles)


def _of_each(first: Any, shape: tuple[int, ...]) -> Any:
    """A controller's memory for each of its settings."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, dtype=float), shape), first)


@dataclass(frozen=True, eq=False)
class Loop:
    """An ECU around draws of a throttle body.

    Args:
        throttles: models, parameters of shape (D,); the nominal one first.
        body: of the rig.
        ecu: the controller.
        bias: feed-forward; None for none.
        settings: of the simulation.
    """

    throttles: Throttle
    body: Body
    ecu: Ecu
    bias: Bias | None = None
    settings: LoopSettings = LoopSettings()

    @property
    def draws(self) -> int:
        """D."""
        return int(np.shape(jax.tree.leaves(self.throttles)[0])[0])

    def first(self, count: int) -> Loop:
        """The loop around the first `count` models only, the nominal one first."""
        return replace(self, throttles=jax.tree.map(lambda leaf: leaf[:count], self.throttles))

    def under(self, ecu: Ecu) -> Loop:
        """The loop with another ECU around its plants."""
        return replace(self, ecu=ecu)

    def in_steps_of(self, longest: float) -> Loop:
        """The loop integrated in steps no longer than so many s."""
        return replace(self, settings=replace(self.settings, longest_step=longest))

    def angle(self, share: Any) -> Any:
        """rad, of a share of the travel."""
        return self.body.lower + share * (self.body.upper - self.body.lower)

    def share(self, angle: Any) -> Any:
        """Of the travel, of an angle in rad."""
        return (angle - self.body.lower) / (self.body.upper - self.body.lower)

    def holds(self, angles: np.ndarray) -> HoldingVoltages:
        """Voltages that hold the nominal plate at these angles (rad), shape (K,)."""
        return hold_curve(self.nominal, angles, *self.body)

    @property
    def nominal(self) -> Throttle:
        """The first model."""
        return jax.tree.map(lambda leaf: leaf[0], self.throttles)

    def linear(self, share: float = MIDDLE) -> TransferFunction:
        """The plants linearised about a share of the travel, rad/V: numbers of shape (D, 1)."""
        rows, delay, lag = _linear(self.throttles, self.angle(share), self.body)
        b0, a2, a1, a0, delay, lag = (np.asarray(v)[:, None] for v in (*rows.T, delay, lag))
        return TransferFunction(b0, a2, a1, a0, delay, lag)  # pyright: ignore[reportArgumentType]

    def respond(self, gains: Gains, setpoint: Setpoint) -> Path:
        """Responses to a setpoint, shape (D, G, K), of gains of shape (G,) each."""
        gains = Gains(*(jnp.asarray(g, dtype=float) for g in gains))
        return self.run(tick, gains, Memory.at_rest(gains, self.ecu, self.angle(setpoint.shares[0])), setpoint)

    def run(
        self, control: Controller, settings: Any, first: Any, setpoint: Setpoint, start: State | None = None
    ) -> Path:
        """Responses to a setpoint, shape (D, G, K), of any controller.

        Args:
            control: as `ecu.tick`: settings, ECU, memory, setpoint, position, bias -> voltage, memory.
            settings: of it, entries of shape (G,).
            first: memory with which it begins, entries of shape () or (G,).
            setpoint: what it follows.
            start: state of every plant at its begin; None: at rest where the setpoint begins.
        """
        wanted = self.angle(setpoint.at(setpoint.instants(self.ecu.period)))
        ahead = self.bias.volts(wanted) if self.bias is not None else np.zeros_like(wanted)
        start = State(0.0, self.angle(setpoint.shares[0]), 0.0) if start is None else start
        first = _of_each(first, np.shape(jax.tree.leaves(settings)[0]))
        parts = max(1, math.ceil(self.ecu.period / self.settings.longest_step - 1e-9))
        run = _Run(settings, first, self.ecu, self.body, wanted, ahead, start)
        return _many(control, self.throttles, run, parts, self._room())

    def judged(self, gains: Gains, setpoint: Setpoint) -> Judged:
        """Figures of the responses, shape (D, G) each."""
        path = self.respond(gains, setpoint)
        return judge(setpoint, setpoint.instants(self.ecu.period), self.share(np.asarray(path.position)))

    def _room(self) -> int:
        """Ticks of delay to remember: a power of two, so that loops of slightly different delays compile once."""
        ticks = (float(np.max(np.asarray(_late(self.throttles)))) + self.ecu.delay) / self.ecu.period
        return min(self.settings.latest, 1 << math.ceil(math.log2(ticks + 2.0))) if ticks > 0.0 else 1
