"""The one stepper: dry friction as a set-valued law, solved exactly inside each implicit stage.

Two-stage L-stable SDIRK, gamma = 1 - 1/sqrt 2 (Alexander 1977), linear-implicit in the smooth part. With the current
eliminated from the linearised stage, the speed obeys the inclusion

    D omega + gamma h F Sgn(omega) = rhs        hence        omega = soft(rhs, gamma h F) / D

(Acary and Brogliato 2008, ch. 1): sticking is exact, nothing is stiff, one to a few steps a sample are enough. The
smooth part of Eqs. 1-2 is linear, so their stages are solved exactly; other effects get one Newton step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from .effects import Contribution, Inputs, State
from .parameters import Scalar
from .throttle import Throttle

StatePath = tuple[State, tuple[Scalar, ...]]  # states and memories; along a batch of shape (T, L) each

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
_OVERSHOOT = (1.0 - GAMMA) / GAMMA


class Command(NamedTuple):
    """What is asked of an ECU that is part of the model during one step.

    Args:
        active: 1 where it drives the throttle.
        begin, end: setpoint at begin and end, as late as its output acts, rad; linear in between.
        rate: slope of the setpoint at once, rad/s.
    """

    active: Scalar
    begin: Scalar
    end: Scalar
    rate: Scalar

    def at(self, fraction: Scalar) -> Scalar:
        """Setpoint at a fraction of the step, rad."""
        return self.begin + fraction * (self.end - self.begin)


class Step(NamedTuple):
    """Everything one step needs besides parameters and state; in a batch each entry has shape (T, L).

    Args:
        dt: length, s; 0 at the first entry of a trace.
        voltage0, voltage1: terminal voltage at its begin and end, V; linear in between.
        torque0, torque1: motor torque at the plate where there is no electrical side, N m.
        time: since the trace began, at the end of the step, s.
        mobile: 0 while the plate is held.
        circuit: 0 where the terminals are open or there is no electrical side.
        plate: 0 where the motor runs alone.
        series: extra circuit resistance, ohm.
        gear_ratio, lower, upper: of the rig; rad.
        guide_stiffness, target0, target1: a guide, 0 in a free run: it draws the plate to the angle measured at
            the step's begin and end (rad) by `guide_stiffness` V/rad at the terminals;
        lever: and where there is no circuit by this torque for each of its volts, N m/V.
        command: None where the model has no ECU in it: then there is nothing to compile of it.
    """

    dt: Scalar
    voltage0: Scalar
    voltage1: Scalar
    torque0: Scalar
    torque1: Scalar
    time: Scalar
    mobile: Scalar
    circuit: Scalar
    plate: Scalar
    series: Scalar
    gear_ratio: Scalar
    lower: Scalar
    upper: Scalar
    guide_stiffness: Scalar
    target0: Scalar
    target1: Scalar
    lever: Scalar
    command: Command | None = None

    def guide(self, fraction: float, theta: Scalar) -> Scalar:
        """What the guide asks for, V."""
        return self.guide_stiffness * (self.target0 + fraction * (self.target1 - self.target0) - theta)

    def inputs(self, fraction: float) -> Inputs:
        """The inputs at a fraction of the step."""
        c = self.command
        asked = {} if c is None else {"controlled": c.active, "setpoint": c.at(fraction), "setpoint_rate": c.rate}
        return Inputs(
            **asked,
            voltage=self.voltage0 + fraction * (self.voltage1 - self.voltage0),
            torque=self.torque0 + fraction * (self.torque1 - self.torque0),
            time=self.time - (1.0 - fraction) * self.dt,
            plate=self.plate,
            series=self.series,
            gear_ratio=self.gear_ratio,
            lower=self.lower,
            upper=self.upper,
        )

    def halves(self) -> tuple[Step, Step]:
        """The step in two of half its length."""
        middle, half, c = self.inputs(0.5), 0.5 * self.dt, self.command
        early = self._replace(dt=half, voltage1=middle.voltage, torque1=middle.torque, time=self.time - half)
        late = self._replace(dt=half, voltage0=middle.voltage, torque0=middle.torque)
        if c is None:
            return early, late
        return early._replace(command=c._replace(end=c.at(0.5))), late._replace(command=c._replace(begin=c.at(0.5)))


class _Line(NamedTuple):
    """A balance linearised about a guess: value = at + i * i + theta * theta + omega * omega."""

    at: Scalar
    i: Scalar
    theta: Scalar
    omega: Scalar


def soft(value: Scalar, threshold: Scalar) -> Scalar:
    """soft(a, b) = sgn(a) max(|a| - b, 0): the resolvent of dry friction."""
    return jnp.maximum(value - threshold, 0.0) + jnp.minimum(value + threshold, 0.0)


@jax.jit
def contributions(throttle: Throttle, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
    """The sum of all effects; compiled into whatever calls it, but traced only once however often it is called."""
    return throttle(x, z, u)


def _linearise(
    throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, fraction: float
) -> tuple[_Line, _Line, Contribution]:
    """Torque and voltage balances about the guess x, by forward-mode differentiation along each state."""
    u = s.inputs(fraction)

    def balances(i: Scalar, theta: Scalar, omega: Scalar) -> tuple[tuple[Scalar, Scalar], Contribution]:
        c = contributions(throttle, State(i, theta, omega), z, u)
        guide = s.guide(fraction, theta)
        torque = c.torque + c.drive + u.torque + (1.0 - s.circuit) * s.lever * guide
        return (torque, c.voltage + u.voltage + s.circuit * guide), c

    one = jnp.ones(())
    (torque, voltage), here = balances(*x)
    _, (torque_i, voltage_i) = jax.jvp(lambda i: balances(i, x.theta, x.omega)[0], (x.i,), (one,))
    _, (torque_th, voltage_th) = jax.jvp(lambda theta: balances(x.i, theta, x.omega)[0], (x.theta,), (one,))
    _, (torque_om, voltage_om) = jax.jvp(lambda omega: balances(x.i, x.theta, omega)[0], (x.omega,), (one,))
    torque_at = torque - torque_i * x.i - torque_th * x.theta - torque_om * x.omega
    voltage_at = voltage - voltage_i * x.i - voltage_th * x.theta - voltage_om * x.omega
    return _Line(torque_at, torque_i, torque_th, torque_om), _Line(voltage_at, voltage_i, voltage_th, voltage_om), here


def _memory(throttle: Throttle, base: tuple[Scalar, ...], guess: tuple[Scalar, ...], x: State, u: Inputs, a: Scalar):
    """z = base + a dz(x, z), linear-implicit in each memory's own decay; a = gamma h."""
    if not base:
        return ()

    def rates(z: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        return contributions(throttle, x, z, u).dz

    rate, slope = jax.jvp(rates, (guess,), (tuple(jnp.ones_like(g) for g in guess),))
    return tuple((b + a * (r - s * g)) / (1.0 - a * s) for b, g, r, s in zip(base, guess, rate, slope, strict=True))


class _Contact(NamedTuple):
    """The stops, and whether the plate rested on one when the step began."""

    lower: Scalar
    upper: Scalar
    on_lower: Scalar
    on_upper: Scalar
    restitution: Scalar

    @classmethod
    def at(cls, throttle: Throttle, x: State, z: tuple[Scalar, ...], u: Inputs) -> _Contact:
        c = contributions(throttle, x, z, u)
        return cls(c.lower, c.upper, x.theta <= c.lower, x.theta >= c.upper, c.restitution)

    def after(self, x: State) -> _Contact:
        """A plate that a stage has moved inward rests no more: held, it would end higher than its energy lifts it."""
        resting = self.on_lower & (x.theta <= self.lower), self.on_upper & (x.theta >= self.upper)
        return _Contact(self.lower, self.upper, *resting, self.restitution)

    def restrain(self, omega: Scalar) -> Scalar:
        """A resting plate must not move outward inside a stage: its speed would leak into the current."""
        omega = jnp.where(self.on_lower, jnp.maximum(omega, 0.0), omega)
        return jnp.where(self.on_upper, jnp.minimum(omega, 0.0), omega)

    def clip(self, before: State, x: State) -> State:
        """A new impact: angle to the stop, speed to zero, or to the share that the stop gives back. Elsewhere in the
        step it would make sensitivities explode. What would end within a step comes to rest."""
        back = -self.restitution * x.omega
        back = jnp.where(jnp.abs(back) > 2.0 * jnp.abs(x.omega - before.omega), back, 0.0)
        omega = jnp.where((x.theta < self.lower) & (x.omega < 0.0), jnp.where(self.on_lower, 0.0, back), x.omega)
        omega = jnp.where((x.theta > self.upper) & (x.omega > 0.0), jnp.where(self.on_upper, 0.0, back), omega)
        return State(x.i, jnp.clip(x.theta, self.lower, self.upper), omega)


def _stage(
    throttle: Throttle, base: State, guess: State, z: tuple[Scalar, ...], s: Step, fraction: float, contact: _Contact
) -> State:
    """Solve x = base + gamma h f(x), dry friction and resting contact included."""
    a = GAMMA * s.dt
    torque, voltage, c = _linearise(throttle, guess, z, s, fraction)
    b = a / c.inductance
    denominator = 1.0 - b * voltage.i
    at = s.circuit * (base.i + b * (voltage.at + voltage.theta * base.theta)) / denominator
    per_speed = s.circuit * b * (voltage.theta * a + voltage.omega) / denominator
    mass = c.inertia - a * (torque.i * per_speed + torque.theta * a + torque.omega)
    rhs = c.inertia * base.omega + a * (torque.at + torque.i * at + torque.theta * base.theta)
    omega = contact.restrain(s.mobile * soft(rhs, a * c.friction) / mass)
    return State(at + per_speed * omega, base.theta + a * omega, omega)


def _extrapolate(start: Scalar, stage: Scalar) -> Scalar:
    return start + _OVERSHOOT * (stage - start)


def step(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> StatePath:
    """One step of the throttle body.

    Args:
        throttle: the model.
        x: state at the begin of the step, scalars, SI.
        z: memories of the effects at the begin of the step.
        s: inputs and boundary conditions, scalars.
    Returns:
        state and memories at its end.
    """
    a = GAMMA * s.dt
    early, late = s.inputs(GAMMA), s.inputs(1.0)
    contact = _Contact.at(throttle, x, z, early)
    z_guess = _memory(throttle, z, z, x, early, a)
    x1 = _stage(throttle, x, x, z_guess, s, GAMMA, contact)
    z1 = _memory(throttle, z, z_guess, x1, early, a)

    base = State(*(_extrapolate(p, q) for p, q in zip(x, x1, strict=True)))
    z_base = tuple(_extrapolate(p, q) for p, q in zip(z, z1, strict=True))
    z_guess = _memory(throttle, z_base, z1, x1, late, a)
    x2 = _stage(throttle, base, x1, z_guess, s, 1.0, contact.after(x1))
    z2 = _memory(throttle, z_base, z_guess, x2, late, a)
    return contact.clip(x, x2), z2


class Reset(NamedTuple):
    """Where a batch begins a new trace; entries of shape (T, L).

    Args:
        begins: 1 at the first entry of a trace, else 0.
        i, theta, omega: state from which it begins.
    """

    begins: Scalar
    i: Scalar
    theta: Scalar
    omega: Scalar


def begun(throttle: Throttle, x: State, z: tuple[Scalar, ...], reset: Reset) -> StatePath:
    """State and memories from which a step sets out: where a trace begins, its own first ones."""
    begins = reset.begins > 0.5
    x = State(
        jnp.where(begins, reset.i, x.i),
        jnp.where(begins, reset.theta, x.theta),
        jnp.where(begins, reset.omega, x.omega),
    )
    return x, tuple(jnp.where(begins, first, now) for first, now in zip(throttle.z0, z, strict=True))


def simulate(throttle: Throttle, steps: Step, resets: Reset) -> StatePath:
    """Run a batch: L lanes side by side, each a sequence of traces one after the other.

    Args:
        throttle: the model.
        steps: entries of shape (T, L).
        resets: entries of shape (T, L).
    Returns:
        state and memories at the end of every step, entries of shape (T, L).
    """
    lanes = steps.dt.shape[1:]
    x0 = State(*(jnp.zeros(lanes) for _ in range(3)))
    z0 = tuple(jnp.full(lanes, z) for z in throttle.z0)

    def advance(carry: StatePath, entry: tuple[Step, Reset]):
        s, reset = entry
        carry = jax.vmap(step, in_axes=(None, 0, 0, 0))(throttle, *begun(throttle, *carry, reset), s)
        return carry, carry

    _, path = jax.lax.scan(advance, (x0, z0), (steps, resets))
    return path
