"""What an effect adds along the path of a body without it moves that path as a little of the effect does."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from etcfit.model.effects import (
    EFFECT_BY_NAME,
    EFFECTS,
    PAPER,
    AbstractEffect,
    Contribution,
    Inputs,
    LoadDependentFriction,
    State,
)
from etcfit.model.input_perturbation import acts_as_input, added, step_inputs_along
from etcfit.model.parameters import Real, Scalar, declared, parameter
from etcfit.model.smooth import UNKNOWNS
from etcfit.model.stepper import Reset, StatePath, Step, simulate
from etcfit.model.throttle import Throttle

OTHERWISE = {"actuation_delay", "channel_delay", "backlash", "stop_bounce"}  # delays, and what needs a simulation each
SERVED = [e for e in (*EFFECTS, *UNKNOWNS) if e not in PAPER and e.name not in OTHERWISE]
STEPS = 300


class Jammed(AbstractEffect):
    """A stop that moves: no input does what it does."""

    name = "jammed"
    off: ClassVar[Mapping[str, float] | None] = {"j": 0.0}
    j: Scalar = parameter("rad", Real(0.1), 0.0, "a stop", "a test")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(upper=1.5 - self.j)


def test_effects_are_inputs_but_for_delays_contacts_and_what_shows_nothing_while_it_is_small() -> None:
    assert {e.name for e in EFFECTS if e not in PAPER and not acts_as_input(e)} == OTHERWISE
    assert all(acts_as_input(e) for e in UNKNOWNS)
    assert not acts_as_input(Jammed)


def excited() -> tuple[Step, Reset]:
    """A voltage that drives the plate off its lower stop, to and fro with pauses, onto the upper one and back."""
    time = np.linspace(0.0, 1.5, STEPS)
    volts = 4.0 * np.sin(9.0 * time) * (np.sin(3.0 * time) > -0.5) + 7.0 * (time > 0.7) * (time < 1.0)
    return bodies.batch(bodies.even(1.5, STEPS), volts, start=(0.0, 0.3, 0.0))


def at_off(effect: type[AbstractEffect]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Its parameters at their off values, and a direction in which all amplitudes grow; by field."""
    rest = {f: (effect.off or {}).get(p.symbol, p.nominal) for f, p in declared(effect).items()}
    way = {f: p.domain.scale * (p.symbol in (effect.off or {})) for f, p in declared(effect).items()}
    return {f: jnp.float64(v) for f, v in rest.items()}, {f: jnp.float64(v) for f, v in way.items()}


def logged(throttle: Throttle, path: StatePath, steps: Step) -> jax.Array:
    """Current and angle as read, shape (T, L, 2)."""
    seen = throttle.observe(*path, steps.inputs(1.0))
    return jnp.stack((seen["current"], seen["position"]), axis=-1)


@cache
def compiled(loaded: bool) -> tuple[Any, Any, Any]:
    """All effects at once, along the path of a body whose friction depends on its load, so that the load counts too; or
    that friction itself, along the path of a body without it.

    What a direction of all effects' parameters does to the readings of the body that has them; what inputs do to those
    of the body without; and where its steps ask an effect. Each is compiled once.
    """
    steps, resets = excited()
    without = bodies.body(LoadDependentFriction, mu_g=0.05) if loaded else bodies.body()
    effects = [e for e in SERVED if (e is LoadDependentFriction) is not loaded]
    rest = {e.name: at_off(e)[0] for e in effects}

    def within(values: dict[str, Any]) -> jax.Array:
        throttle = Throttle((*without.effects, *(e(**values[e.name]) for e in effects)))
        return logged(throttle, simulate(throttle, steps, resets), steps)

    def moved(acts: Any) -> jax.Array:
        disturbed = steps._replace(besides=acts)
        return logged(without, simulate(without, disturbed, resets), disturbed)

    def along(acts: Any) -> jax.Array:
        return jax.jvp(moved, (jax.tree.map(jnp.zeros_like, acts),), (acts,))[1]

    asked = step_inputs_along(without, simulate(without, steps, resets), steps, resets)
    return jax.jit(lambda way: jax.jvp(within, (rest,), (way,))[1]), jax.jit(along), asked


@pytest.mark.slow
@pytest.mark.parametrize("effect", SERVED, ids=lambda effect: effect.name)
def test_a_little_of_an_effect_and_what_it_adds_do_the_same(effect: type[AbstractEffect]) -> None:
    """To rounding."""
    within, along, asked = compiled(effect is not LoadDependentFriction)
    rest, way = at_off(effect)
    still = {e.name: jax.tree.map(jnp.zeros_like, at_off(e)[0]) for e in SERVED
             if (e is LoadDependentFriction) is (effect is LoadDependentFriction)}  # fmt: skip
    theirs, ours = within(still | {effect.name: way}), along(added(effect, rest, way, asked, *excited()))
    size = float(jnp.abs(theirs).max())
    assert size > 1e-4  # it does something at all
    assert_allclose(ours, theirs, atol=1e-9 * size)


def test_the_path_meets_both_stops_sticks_and_moves() -> None:
    """Else the comparison above would say little."""
    path = bodies.path(bodies.body(LoadDependentFriction, mu_g=0.05), *excited())
    theta, omega = path[:, 1], path[:, 2]
    assert np.sum(theta <= 0.0) > 5
    assert np.sum(theta >= bodies.OPEN) > 5
    between = (theta > 0.0) & (theta < bodies.OPEN)
    assert np.sum(between & (omega == 0.0)) > 5
    assert np.sum(between & (np.abs(omega) > 0.5)) > 50


@pytest.mark.slow
def test_nothing_besides_is_nothing() -> None:
    steps, resets = excited()
    throttle = bodies.body()
    asked = step_inputs_along(throttle, simulate(throttle, steps, resets), steps, resets)
    rest, way = at_off(EFFECT_BY_NAME["gravity_load"])
    nothing = added(EFFECT_BY_NAME["gravity_load"], rest, jax.tree.map(jnp.zeros_like, way), asked, steps, resets)
    there = bodies.path(throttle, steps._replace(besides=nothing), resets)
    assert_array_equal(there, bodies.path(throttle, steps, resets))
