"""The one stepper: dry friction as a set-valued law, solved exactly inside each implicit stage.

Two-stage L-stable SDIRK, gamma = 1 - 1/sqrt 2 (Alexander 1977), linear-implicit in the smooth part. With the current
eliminated from the linearised stage, the speed obeys the inclusion

    D omega + gamma h F Sgn(omega) = rhs        hence        omega = soft(rhs, gamma h F) / D

(Acary and Brogliato 2008, ch. 1): sticking is exact, nothing is stiff, one to a few steps per sample are enough. The
smooth part of Eqs. 1-2 is linear, so their stages are solved exactly; other effects get one Newton step.

The tangent of a step is written explicitly (`_step_and_tangent`): it differentiates the equations of each stage at
their solution, which is exact for this scheme and takes a fraction of the time of differentiating the solver.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Bool

from .effects import Besides, Contribution, Inputs, State
from .parameters import AnyArray, Scalar
from .tangents import forward, fusion_barrier, instantiated
from .throttle import Throttle

StatePath = tuple[State, tuple[Scalar, ...]]  # states and memories; along a batch of shape (T, L) each

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
_OVERSHOOT = (1.0 - GAMMA) / GAMMA
_APART = 0.02  # torque at which a motor leaves the teeth of a resting plate, N m; above the noise of its voltage


class Command(NamedTuple):
    """Inputs of an ECU that is part of the model during one step."""

    active: Scalar  # 1 if it drives the throttle
    tick: Scalar  # 1 if its output changes at the step's begin, else 0
    setpoint: Scalar  # the setpoint that it read for that tick, rad
    ahead: Scalar  # its feed-forward for that setpoint, a share of its supply
    origin: Scalar  # angle at which the trace began, rad


class Edge(NamedTuple):
    """Dependence of the steps between two samples on the instant of a jump of the input, a share s of the interval."""

    turn: Scalar  # 0 or 1: s = turn + phase of the rig test's edges (`rig_effects.edge_phase`)
    span: Scalar  # d dt / ds of the step, s: > 0 before the jump, < 0 after it, 0 without a jump
    moves: Scalar  # d time / ds of the step's end, s


class StepBesides(NamedTuple):
    """Known contributions in the two stages of a step in addition to all effects; its readings are at the step's
    end."""

    early: Besides
    late: Besides

    @classmethod
    def nothing(cls) -> StepBesides:
        """Nothing besides."""
        return cls(*(Besides(*(0.0,) * len(Besides._fields)),) * 2)


class Acting(NamedTuple):
    """Voltage (V) and motor torque (N m) at the begin and the end of a step, as in `Step`."""

    voltage0: Scalar
    voltage1: Scalar
    torque0: Scalar
    torque1: Scalar


class Step(NamedTuple):
    """All data of one step except parameters and state; in a batch each entry has shape (T, L)."""

    dt: Scalar  # length, s; 0 at the first entry of a trace
    # voltage0, voltage1: terminal voltage at its begin and end, V; linear in between
    voltage0: Scalar
    voltage1: Scalar
    # torque0, torque1: motor torque at the plate if there is no electrical side, N m
    torque0: Scalar
    torque1: Scalar
    time: Scalar  # time since the trace began, at the end of the step, s
    mobile: Scalar  # 0 while the plate is held, else 1
    circuit: Scalar  # 0 if the terminals are open or there is no electrical side, else 1
    plate: Scalar  # 0 if the motor runs alone, else 1
    series: Scalar  # extra circuit resistance, ohm
    gear_ratio: Scalar  # N, motor angle over plate angle
    # lower, upper: end stops, rad
    lower: Scalar
    upper: Scalar
    guide_stiffness: Scalar  # stiffness of a guide along the measured angle, V/rad at the terminals; 0 in a free run
    # target0, target1: measured angle at the step's begin and end, rad
    target0: Scalar
    target1: Scalar
    lever: Scalar  # torque of the guide per volt if there is no circuit, N m/V
    command: Command | None = None  # inputs of an ECU in the model; None without an ECU
    edge: Edge | None = None  # data of an edge in step with the samples; None if there is none
    trace: Scalar | None = None  # `number_of` the file of the trace; None if the batch was not made of traces
    # duty of a bridge whose supply was not logged, -1 to 1, 0 in other traces; None if there is none
    duty: Scalar | None = None
    # known contributions in addition to the effects, or None. No ECU in the model sees its readings.
    besides: StepBesides | None = None
    acting: Acting | None = None  # voltage and torque that act in place of the rig's, if they act late; else None

    @property
    def levels(self) -> Acting:
        """Voltage and torque."""
        return Acting(self.voltage0, self.voltage1, self.torque0, self.torque1)

    def guide(self, fraction: float, theta: Scalar) -> Scalar:
        """Voltage of the guide at a fraction of the step for a plate at theta (rad), V."""
        return self.guide_stiffness * (self.target0 + fraction * (self.target1 - self.target0) - theta)

    def inputs(self, fraction: float) -> Inputs:
        """The inputs at a fraction of the step: 0 at its begin, 1 at its end."""
        c = self.command
        ecu_inputs = {} if c is None else {"controlled": c.active, "setpoint": c.setpoint, "ahead": c.ahead}
        acts = None if self.besides is None else {GAMMA: self.besides.early, 1.0: self.besides.late}.get(fraction)
        return Inputs(
            **ecu_inputs,
            besides=acts,
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
        """The step as two of half its length, their inputs those of its halves."""
        middle, half, c = self.inputs(0.5), 0.5 * self.dt, self.command
        early = self._replace(dt=half, voltage1=middle.voltage, torque1=middle.torque, time=self.time - half)
        late = self._replace(dt=half, voltage0=middle.voltage, torque0=middle.torque)
        return early, late if c is None else late._replace(command=c._replace(tick=jnp.zeros_like(c.tick)))


class _Balances(NamedTuple):
    """The balances of plate and armature loop: smooth torque (N m) and voltage (V), the guide's included; dry friction
    (N m), inertia (kg m2) and inductance (H)."""

    torque: Scalar
    voltage: Scalar
    friction: Scalar
    inertia: Scalar
    inductance: Scalar


class _Slopes(NamedTuple):
    """Derivatives of a balance in each state."""

    i: Scalar
    theta: Scalar
    omega: Scalar


def soft(value: Scalar, threshold: Scalar) -> Scalar:
    """soft(a, b) = sgn(a) max(|a| - b, 0): the resolvent of dry friction."""
    return jnp.maximum(value - threshold, 0.0) + jnp.minimum(value + threshold, 0.0)


@jax.jit
def contributions(throttle: Throttle, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
    """The sum of all effects; traced once for all calls, and compiled into the caller.

    Args:
        x: state, SI.
        z: memories of its effects.
    """
    return throttle(x, z, u)


def _balances(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, fraction: float) -> _Balances:
    u = s.inputs(fraction)
    c = contributions(throttle, x, z, u)
    guide = s.guide(fraction, x.theta)
    torque = c.torque + c.drive + u.torque + (1.0 - s.circuit) * s.lever * guide
    return _Balances(torque, c.voltage + u.voltage + s.circuit * guide, c.friction, c.inertia, c.inductance)


def _slopes(
    throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, fraction: float
) -> tuple[_Balances, _Slopes, _Slopes]:
    """The balances at x, and the derivatives of torque and voltage in each state there."""

    def smooth(i: Scalar, theta: Scalar, omega: Scalar) -> tuple[tuple[Scalar, Scalar], _Balances]:
        b = _balances(throttle, State(i, theta, omega), z, s, fraction)
        return (b.torque, b.voltage), b

    one = jnp.ones(())
    _, along_i, here = jax.jvp(lambda i: smooth(i, x.theta, x.omega), (x.i,), (one,), has_aux=True)
    _, along_theta = jax.jvp(lambda theta: smooth(x.i, theta, x.omega)[0], (x.theta,), (one,))
    _, along_omega = jax.jvp(lambda omega: smooth(x.i, x.theta, omega)[0], (x.omega,), (one,))
    torque, voltage = (_Slopes(*each) for each in zip(along_i, along_theta, along_omega, strict=True))
    return here, torque, voltage


def _about(throttle: Throttle, guess: State, z: tuple[Scalar, ...], s: Step, fraction: float, x: State) -> _Balances:
    """The balances at x in the stage: torque and voltage linearised about its guess, the rest as at the guess."""
    way = State(*(to - start for to, start in zip(x, guess, strict=True)))
    here, slope = jax.jvp(lambda x: _balances(throttle, x, z, s, fraction), (guess,), (way,))
    return here._replace(torque=here.torque + slope.torque, voltage=here.voltage + slope.voltage)


def memory(
    throttle: Throttle, base: tuple[Scalar, ...], guess: tuple[Scalar, ...], x: State, u: Inputs, a: Scalar
) -> tuple[Scalar, ...]:
    """Memories at the end of a stage: z = base + a dz(x, z), linear-implicit in each memory's own decay; a = gamma h.

    Args:
        base: memories at the begin of the stage.
        guess: memories about which the rates are linearised.
        x, u: state and inputs at which the effects are evaluated.
        a: s.
    """
    if not base:
        return ()

    def rates(z: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        return contributions(throttle, x, z, u).dz

    rate, slope = jax.jvp(rates, (guess,), (tuple(jnp.ones_like(g) for g in guess),))
    return tuple((b + a * (r - s * g)) / (1.0 - a * s) for b, g, r, s in zip(base, guess, rate, slope, strict=True))


class _Play(NamedTuple):
    """The play of a gear while the plate rests on its lower stop: there the motor turns alone."""

    there: Bool[AnyArray, ...]  # whether there is any play
    alone: Bool[AnyArray, ...]  # whether the motor turns alone
    stop: Scalar  # stop of the plate, rad, at which the teeth that open it are
    fastest: Scalar  # speed that crosses the play within the step, rad/s
    damping: Scalar  # c of an impact on the teeth of a plate on its stop, s/rad
    restitution: Scalar  # share of the speed after an impact on the teeth that open the plate

    @classmethod
    def at(cls, x: State, u: Inputs, c: Contribution, dt: Scalar) -> _Play:
        """The motor is alone below the stop, and at the stop if it moves or is driven away from the plate's teeth."""
        there = (c.play > 0.0) & (u.plate > 0.5)
        away = (x.theta < c.lower) | (x.omega < 0.0) | (c.drive + u.torque < -_APART)
        fastest = c.play / jnp.where(dt > 0.0, dt, 1.0)
        alone = there & (x.theta <= c.lower) & away
        return cls(there, alone, c.lower, fastest, c.tooth_damping, c.tooth_restitution)

    def closing(self, omega: Scalar) -> Scalar:
        """Speed after an impact on the teeth of a plate that is pressed onto its stop: -w/(1 + c |w|)."""
        return self._within(-omega / (1.0 + self.damping * jnp.abs(omega)))

    def opening(self, omega: Scalar) -> Scalar:
        """Speed after an impact on the teeth that open the plate: -e w."""
        return self._within(-self.restitution * omega)

    def _within(self, back: Scalar) -> Scalar:
        """A motor that would rattle within the step comes to rest."""
        return jnp.where(jnp.abs(back) < self.fastest, back, 0.0)


class _Contact(NamedTuple):
    """The stops, and whether the plate rested on one when the step began; for a motor that turns alone, the ends of its
    play. In a model without play `play.there` is False."""

    lower: Scalar
    upper: Scalar
    on_lower: Bool[AnyArray, ...]
    on_upper: Bool[AnyArray, ...]
    restitution: Scalar
    play: _Play

    @classmethod
    def at(cls, throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> _Contact:
        u = s.inputs(GAMMA)
        c = contributions(throttle, x, z, u)
        play = _Play.at(x, u, c, s.dt)
        lower = jnp.where(u.plate > 0.5, c.lower - c.play, c.lower)
        upper = jnp.where(play.alone, c.lower, c.upper)
        on_lower = x.theta <= jnp.where(play.alone, lower, c.lower)
        return cls(lower, upper, on_lower, (x.theta >= upper) & ~play.alone, c.restitution, play)

    def acting(self, s: Step) -> Step:
        """The step, without plate and gear if the motor turns alone."""
        return s._replace(plate=jnp.where(self.play.alone, 0.0, s.plate))

    def after(self, x: State) -> _Contact:
        """A plate that a stage has moved inward no longer rests: otherwise it would end above the height of its
        energy."""
        rest = jnp.where(self.play.alone, self.lower, self.play.stop)
        return self._replace(
            on_lower=self.on_lower & (x.theta <= rest), on_upper=self.on_upper & (x.theta >= self.upper)
        )

    def restrains(self, omega: Scalar) -> Bool[AnyArray, ...]:
        """A resting plate must not move outward inside a stage: its speed would leak into the current."""
        return (self.on_lower & (omega < 0.0)) | (self.on_upper & (omega > 0.0))

    def clip(self, before: State, x: State) -> State:
        """A new impact: angle to the stop, speed to zero at the end of the step: within it sensitivities would explode.
        Where the stop gives back a share e of the speed, the plate is where that leads it in the rest of the step.
        With dt' the time since the impact and g the change of speed during it, of the step's, in proportion:

            omega' = -e (omega - g) + g,    theta' = stop + (-e (omega - g) + g/2) dt',    dt' = beyond/(omega - g/2)

        A rebound that would end within a step comes to rest."""
        low, high = (x.theta < self.lower) & (x.omega < 0.0), (x.theta > self.upper) & (x.omega > 0.0)
        hit, stop = low | high, jnp.clip(x.theta, self.lower, self.upper)
        change, beyond = x.omega - before.omega, x.theta - stop
        bounces = self.restitution > 0.0  # a constant in a model without such an effect: kernels then skip all of it
        after = jnp.where(bounces, change * beyond / jnp.where(hit, x.theta - before.theta, 1.0), 0.0)
        back = -self.restitution * (x.omega - after)
        below = jnp.where(self.play.there, self.play.closing(x.omega), back + after)
        above = jnp.where(self.play.alone, self.play.opening(x.omega), back + after)
        bounces &= ~jnp.where(low, self.play.there, self.play.alone)  # of teeth: as if they met at the end of the step
        rebound = jnp.where(low, below, above)
        rests = jnp.where(low, self.on_lower, self.on_upper) | (jnp.abs(rebound) <= 2.0 * jnp.abs(change))
        away = bounces & hit & ~rests
        way = (back + 0.5 * after) * beyond / jnp.where(away, x.omega - 0.5 * after, 1.0)
        omega = jnp.where(hit, jnp.where(rests, 0.0, rebound), x.omega)
        return State(x.i, jnp.where(away, stop + way, stop), omega)


class _Stage(NamedTuple):
    """A solved stage, with the data for its tangents."""

    x: State  # its state
    free: Scalar  # 1 if the plate moves or may move, 0 if it sticks, is held, or rests on a stop
    # torque, voltage: slopes of the balances
    torque: _Slopes
    voltage: _Slopes
    # friction, inertia, inductance: values at the guess
    friction: Scalar
    inertia: Scalar
    inductance: Scalar
    per_speed: Scalar  # di/domega; mass, share: divisors of the equations of speed and current
    mass: Scalar
    share: Scalar


def _stage(
    throttle: Throttle, base: State, guess: State, z: tuple[Scalar, ...], s: Step, fraction: float, contact: _Contact
) -> _Stage:
    """Solve x = base + gamma h f(x), dry friction and resting contact included."""
    a = GAMMA * s.dt
    here, torque, voltage = _slopes(throttle, guess, z, s, fraction)
    b = a / here.inductance
    share = 1.0 - b * voltage.i
    per_speed = s.circuit * b * (voltage.theta * a + voltage.omega) / share
    mass = here.inertia - a * (torque.i * per_speed + torque.theta * a + torque.omega)
    at_guess = State(*(-each for each in guess))
    torque_at, voltage_at = here.torque + _along(torque, at_guess), here.voltage + _along(voltage, at_guess)
    at = s.circuit * (base.i + b * (voltage_at + voltage.theta * base.theta)) / share
    rhs = here.inertia * base.omega + a * (torque_at + torque.i * at + torque.theta * base.theta)
    dry = a * here.friction
    slips = (jnp.abs(rhs) > dry) | (dry == 0.0)
    omega = s.mobile * soft(rhs, dry) / mass
    held = contact.restrains(omega)
    free = jnp.where(slips & ~held, s.mobile, 0.0)
    omega = jnp.where(held, 0.0, omega)
    x = fusion_barrier(State(at + per_speed * omega, base.theta + a * omega, omega))
    return _Stage(x, free, torque, voltage, *here[2:], per_speed, mass, share)


def _along(slopes: _Slopes, way: State) -> Scalar:
    return sum(slope * each for slope, each in zip(slopes, way, strict=True))


def _pushed(stage: _Stage, base: State, dbase: State, d: _Balances, s: Step, longer: Scalar | None) -> State:
    """Tangent of a stage by the implicit function theorem.

    Args:
        base, dbase: its initial state, and the tangent.
        d: tangent of the balances at the stage's own state.
        longer: tangent of its length over the length; None if the length is fixed.
    """
    a, x, d = GAMMA * s.dt, stage.x, fusion_barrier(d)
    if longer is not None:  # the change of the state in a stage grows with its length
        dbase = State(
            dbase.i + longer * (x.i - base.i),
            dbase.theta + longer * (x.theta - base.theta),
            dbase.omega + longer * (x.omega - base.omega),
        )
    b = a / stage.inductance
    volts = d.voltage + stage.voltage.theta * dbase.theta
    at = dbase.i + b * volts - d.inductance / stage.inductance * (x.i - base.i)
    at = s.circuit * at / stage.share
    torque = d.torque + stage.torque.i * at + stage.torque.theta * dbase.theta - jnp.sign(x.omega) * d.friction
    impulse = stage.inertia * dbase.omega + a * torque - d.inertia * (x.omega - base.omega)
    omega = fusion_barrier(stage.free * impulse / stage.mass)
    at = fusion_barrier(at)
    return State(at + stage.per_speed * omega, dbase.theta + a * omega, omega)


def _extrapolate(start: Scalar, stage: Scalar) -> Scalar:
    return start + _OVERSHOOT * (stage - start)


class Stages(NamedTuple):
    """A whole step: its two stages, and the memories of each at its solution and at its end."""

    contact: _Contact
    z_early: tuple[Scalar, ...]
    first: _Stage
    z1: tuple[Scalar, ...]
    z_late: tuple[Scalar, ...]
    second: _Stage
    z2: tuple[Scalar, ...]


def between(x: Any, x1: Any) -> Any:
    """Initial states or memories of the second stage, from those at the step's begin and at the first stage's end."""
    return jax.tree.map(_extrapolate, x, x1)


def stages(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> Stages:
    """Both stages of a step without a tick at its begin; arguments as of `step`."""
    a = GAMMA * s.dt
    contact = _Contact.at(throttle, x, z, s)
    s = contact.acting(s)
    early, late = s.inputs(GAMMA), s.inputs(1.0)
    z_early = memory(throttle, z, z, x, early, a)
    first = _stage(throttle, x, x, z_early, s, GAMMA, contact)
    z1 = memory(throttle, z, z_early, first.x, early, a)
    z_late = memory(throttle, between(z, z1), z1, first.x, late, a)
    second = _stage(throttle, between(x, first.x), first.x, z_late, s, 1.0, contact.after(first.x))
    z2 = memory(throttle, between(z, z1), z_late, second.x, late, a)
    return Stages(contact, z_early, first, z1, z_late, second, z2)


def step(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> StatePath:
    """One step of the throttle body, including an ECU's tick at its begin.

    Args:
        x: state at the begin of the step, scalars, SI.
        z: memories of the effects at the begin of the step.
        s: inputs and boundary conditions, scalars.
    Returns:
        State and memories at its end.
    """
    return step_between_ticks(throttle, x, ticked(throttle, x, z, s), s)


def ticked(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> tuple[Scalar, ...]:
    """Memories after the tick at the begin of a step, if there is one; arguments as of `step`."""
    if s.command is None:
        return z
    after = throttle.ticked(x, z, s.inputs(0.0))
    return tuple(jnp.where(s.command.tick > 0.5, new, old) for new, old in zip(after, z, strict=True))


@jax.custom_jvp
def step_between_ticks(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> StatePath:
    """The step with the ECU's previous output held; equal to `step` without a tick."""
    taken = stages(throttle, x, z, s)
    return taken.contact.clip(x, taken.second.x), taken.z2


def _step_and_tangent(primals: Any, tangents: Any) -> tuple[StatePath, StatePath]:
    """The step and its tangent: each stage by the implicit function theorem, memories and stops directly.

    The length of a step has a tangent if the clock is wrong.
    """
    throttle, x, z, s = primals
    dthrottle, dx, dz, ds = tangents
    fixed = isinstance(ds.dt, SymbolicZero)
    longer = None if fixed else jnp.where(s.dt > 0.0, ds.dt / jnp.where(s.dt > 0.0, s.dt, 1.0), 0.0)
    dx, dz = instantiated((x, z), (dx, dz))
    taken, logged = fusion_barrier(stages(throttle, x, z, s)), s
    first, second, s = taken.first, taken.second, taken.contact.acting(s)

    def remembered(fraction: float, base: Any, guess: Any, at: State, dbase: Any, dguess: Any, dat: State) -> Any:
        """Tangent of the memories of a stage."""

        def end_memory(throttle: Throttle, base: Any, guess: Any, at: State, s: Step) -> Any:
            return memory(throttle, base, guess, at, s.inputs(fraction), GAMMA * s.dt)

        return (
            forward(end_memory, (throttle, base, guess, at, s), (dthrottle, dbase, dguess, dat, ds))[1] if base else ()
        )

    def balanced(fraction: float, guess: State, z: Any, at: State, dguess: State, dz: Any) -> _Balances:
        """Tangent of the balances of a stage at its end `at`, which is held constant."""
        about = partial(_about, fraction=fraction, x=at)
        return forward(about, (throttle, guess, z, s), (dthrottle, dguess, dz, ds))[1]

    dz_early = remembered(GAMMA, z, z, x, dz, dz, dx)
    d = balanced(GAMMA, x, taken.z_early, first.x, dx, dz_early)
    dx1 = _pushed(first, x, dx, d, s, longer)
    dz1 = remembered(GAMMA, z, taken.z_early, first.x, dz, dz_early, dx1)

    (base, z_base), (dbase, dz_base) = between((x, z), (first.x, taken.z1)), between((dx, dz), (dx1, dz1))
    dz_late = remembered(1.0, z_base, taken.z1, first.x, dz_base, dz1, dx1)
    d = balanced(1.0, first.x, taken.z_late, second.x, dx1, dz_late)
    dx2 = _pushed(second, base, dbase, d, s, longer)
    dz2 = remembered(1.0, z_base, taken.z_late, second.x, dz_base, dz_late, dx2)

    def limits(throttle: Throttle, s: Step) -> tuple[Scalar, ...]:
        """Properties of the contact that depend on parameters; whether the plate rests or the motor is alone is held
        constant."""
        at = _Contact.at(throttle, x, z, s)
        return at.lower, at.upper, at.restitution, at.play.damping, at.play.restitution

    def clipped(limits: Any, before: State, after: State) -> State:
        lower, upper, restitution, *teeth = limits
        play = taken.contact.play._replace(damping=teeth[0], restitution=teeth[1])
        contact = taken.contact._replace(lower=lower, upper=upper, restitution=restitution, play=play)
        return contact.clip(before, after)

    at, dlimits = forward(limits, (throttle, logged), (dthrottle, ds))
    end, dend = jax.jvp(clipped, (at, x, second.x), (dlimits, dx, dx2))
    return (end, taken.z2), fusion_barrier((dend, dz2))


step_between_ticks.defjvp(_step_and_tangent, symbolic_zeros=True)


class Reset(NamedTuple):
    """The begins of traces in a batch; entries of shape (T, L)."""

    begins: Scalar  # 1 at the first entry of a trace, else 0
    # i, theta, omega: initial state, A, rad and rad/s
    i: Scalar
    theta: Scalar
    omega: Scalar


def begun(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, reset: Reset) -> StatePath:
    """State and memories at the begin of a step: those of the step before, or the initial ones if a trace begins.

    Args:
        throttle: the model, for the first memories.
        x, z: state and memories at the end of the step before.
        reset: whether a trace begins here, and its initial state.
    """
    begins = reset.begins > 0.5
    x = State(
        jnp.where(begins, reset.i, x.i),
        jnp.where(begins, reset.theta, x.theta),
        jnp.where(begins, reset.omega, x.omega),
    )
    firsts = throttle.first(x, s.inputs(0.0))
    return x, tuple(jnp.where(begins, first, now) for first, now in zip(firsts, z, strict=True))


def simulate(throttle: Throttle, steps: Step, resets: Reset) -> StatePath:
    """Simulate a batch: L parallel lanes, each a sequence of traces.

    Args:
        steps: entries of shape (T, L).
        resets: entries of shape (T, L).
    Returns:
        State and memories at the end of every step, entries of shape (T, L).
    """
    lanes = steps.dt.shape[1:]
    x0 = State(*(jnp.zeros(lanes) for _ in range(3)))
    z0 = tuple(jnp.full(lanes, z) for z in throttle.z0)

    def advance(carry: StatePath, entry: tuple[Step, Reset]):
        s, reset = entry
        carry = jax.vmap(lambda x, z, s, reset: step(throttle, *begun(throttle, x, z, s, reset), s))(*carry, s, reset)
        return carry, carry

    _, path = jax.lax.scan(advance, (x0, z0), (steps, resets))
    return path
