"""The first-order change of the model's path by an effect that is not in the model.

An amplitude a at its off value does not change the path. So the effect's action on every step is known beforehand: its
contribution, per unit of a, at the states and inputs at which a step evaluates the effects of the model. As a `Besides`
of that step it moves the path as the effect would, and only the step's own tangent has to be differentiated.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .effects import AbstractEffect, Besides, Contribution, Inputs, State
from .parameters import Scalar, declared
from .stepper import GAMMA, Reset, Step, StepBesides, begun, between, memory, stages
from .throttle import Throttle

# parts of a contribution that act as an input; positions and restitution of stops, and delays, do not
_KNOWN = ("torque", "drive", "voltage", "friction", "position", "current", "dz")


class StageInputs(NamedTuple):
    """The point at which a stage of a step evaluates the effects."""

    x: State  # the state that the stage guesses
    u: Inputs  # inputs there, the gear's load included
    # dx, du: changes from there to the end of the stage, loads to first order
    dx: State
    du: Inputs


class StepInputs(NamedTuple):
    """The points at which one step evaluates the effects: in its two stages, and at its end for the readings; and the
    sensors' readings of position (rad) and current (A) there."""

    early: StageInputs
    late: StageInputs
    end: State
    read: Inputs
    position: Scalar
    current: Scalar


@cache
def acts_as_input(effect: type[AbstractEffect]) -> bool:
    """Whether a small amplitude of an effect acts as a known input along the path: it adds to torque, voltage, friction
    or a reading at that instant, and is not one of the effects without any action at small amplitudes."""
    if effect.delays or effect.commands or set(effect.off or {}) & set(effect.scan) or (effect.loaded and effect.z0):
        return False
    return _contributes(effect, {field: p.nominal for field, p in declared(effect).items()}) <= {*_KNOWN}


@cache
def only_delays(effect: type[AbstractEffect]) -> bool:
    """Whether an effect only delays input or channels, by amplitudes without scan values."""
    if not effect.delays or effect.commands or effect.z0 or set(effect.off or {}) & set(effect.scan):
        return False
    try:
        found = _contributes(effect, {field: p.domain.scale for field, p in declared(effect).items()})
    except TypeError:  # the throttle does not evaluate an effect of the rig
        return False
    return all(name.endswith("_delay") for name in found)


def _contributes(effect: type[AbstractEffect], values: Mapping[str, float]) -> set[str]:
    """Names of what an effect contributes. It is traced: if it were computed, JAX would compile each operation of it by
    itself."""
    here, u = State(1.0, 0.1, 1.0), Inputs(1.0, 0.0, 1.0, 1.0, 0.0, 16.0, 0.0, 1.5, motor=1.0, external=1.0)
    found = set[str]()

    def contribute(here: State, u: Inputs) -> None:
        added, nothing = effect(**values)(here, effect.z0, u), Contribution()
        found.update(name for name in Contribution._fields if getattr(added, name) is not getattr(nothing, name))

    jax.eval_shape(contribute, here, u)
    return found


def step_inputs(throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step) -> StepInputs:
    """The points at which one step evaluates the effects; arguments as of `step_between_ticks`, without an ECU in the
    model."""
    taken = stages(throttle, x, z, s)
    acting = taken.contact.acting(s)

    def stage(guess: State, z: tuple[Scalar, ...], fraction: float, end: State) -> StageInputs:
        way = State(*(to - start for to, start in zip(end, guess, strict=True)))
        u = acting.inputs(fraction)
        here, along = jax.jvp(lambda x: throttle.informed(x, z, u), (guess,), (way,))
        return StageInputs(guess, here, way, along)

    end = taken.contact.clip(x, taken.second.x)
    early = stage(x, taken.z_early, GAMMA, taken.first.x)
    late = stage(taken.first.x, taken.z_late, 1.0, taken.second.x)
    u = s.inputs(1.0)
    shown = throttle.observe(end, taken.z2, u)
    return StepInputs(early, late, end, throttle.informed(end, taken.z2, u), shown["position"], shown["current"])


def step_inputs_along(throttle: Throttle, path: Any, steps: Step, resets: Reset) -> StepInputs:
    """The points at which every step of a batch evaluates the effects; entries of shape (T, L).

    Args:
        path: its states and memories at the end of each step, as `simulate` returns them.
    """
    x, z = jax.tree.map(lambda leaf: jnp.concatenate((jnp.zeros_like(leaf[:1]), leaf[:-1])), path)

    def one(x: State, z: tuple[Scalar, ...], s: Step, reset: Reset) -> StepInputs:
        at, memories = begun(throttle, x, z, s, reset)
        return step_inputs(throttle, at, memories, s)

    return jax.vmap(jax.vmap(one))(x, z, steps, resets)


def added(
    effect: type[AbstractEffect],
    values: Mapping[str, Scalar],
    ways: Mapping[str, Scalar],
    along: StepInputs,
    steps: Step,
    resets: Reset,
) -> StepBesides:
    """The contribution of an effect to every step of a batch, differentiated along a direction of its parameters.

    Args:
        effect: an effect that `acts_as_input`.
        values: values of its parameters, SI by field.
        ways: the direction, SI by field.
        along: points at which the steps evaluate it, entries of shape (T, L).
    Returns:
        Entries of shape (T, L), SI.
    """
    one = jax.vmap(lambda carried, entry: added_at(effect, values, ways, carried, entry))
    zero = jnp.zeros(steps.dt.shape[1:])
    carried = (tuple(zero for _ in effect.z0),) * 2
    return jax.lax.scan(lambda carried, entry: one(carried, entry), carried, (along, steps, resets))[1]


def added_at(
    effect: type[AbstractEffect],
    values: Mapping[str, Scalar],
    ways: Mapping[str, Scalar],
    carried: Any,
    entry: tuple[StepInputs, Step, Reset],
) -> tuple[Any, StepBesides]:
    """The same for one step.

    Args:
        effect, values, ways: as of `added`.
        carried: the effect's memories at the end of the step before, and their tangents.
        entry: the points at which the step evaluates it, the step, and whether a trace begins there.
    Returns:
        The carry, and the contribution of the effect.
    """
    along, s, reset = entry

    def contributed(values: Mapping[str, Scalar], z: tuple[Scalar, ...]) -> tuple[tuple[Scalar, ...], StepBesides]:
        mine = effect(**values)
        early, late, end = _memories(mine, along, s, reset, z)

        def stage(where: StageInputs, z: tuple[Scalar, ...]) -> Besides:
            here, slope = jax.jvp(
                lambda x, u: _besides(mine(x, z, u), mine.loaded), (where.x, where.u), (where.dx, where.du)
            )
            return here._replace(torque=here.torque + slope.torque, voltage=here.voltage + slope.voltage)

        read = mine(along.end, end, along.read)
        second = stage(along.late, late)._replace(position=read.position, current=read.current)
        return end, jax.tree.map(lambda each: jnp.asarray(each, float), StepBesides(stage(along.early, early), second))

    (end, _), (dend, way) = jax.jvp(contributed, (dict(values), carried[0]), (dict(ways), carried[1]))
    return (end, dend), way


def _besides(c: Contribution, loaded: bool) -> Besides:
    """The contribution of an effect to a stage; a `loaded` effect does not count in the load of the gear."""
    motor, external = (0.0, 0.0) if loaded else (c.drive, c.torque)
    acts = Besides(c.torque + c.drive, c.voltage, c.friction, 0.0, 0.0, motor, external)
    return jax.tree.map(lambda each: jnp.asarray(each, float), acts)


def _memories(effect: AbstractEffect, along: StepInputs, s: Step, reset: Reset, z: Any) -> Any:
    """An effect's own memories at the first and the second stage and at the end of the step; () each for an effect
    without memory."""
    if not effect.z0:
        return (), (), ()
    alone, (early, late, *_) = Throttle((effect,)), along
    firsts = effect.first(early.u.motor + early.u.external)
    z = tuple(jnp.where(reset.begins > 0.5, first, now) for first, now in zip(firsts, z, strict=True))
    a, second = GAMMA * s.dt, State(*(at + way for at, way in zip(late.x, late.dx, strict=True)))
    z_early = memory(alone, z, z, early.x, early.u, a)
    z1 = memory(alone, z, z_early, late.x, early.u, a)
    z_late = memory(alone, between(z, z1), z1, late.x, late.u, a)
    return z_early, z_late, memory(alone, between(z, z1), z_late, second, late.u, a)
