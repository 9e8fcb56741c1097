"""The tangent of a step, written out, is what JAX derives from the step; derivatives along what moves and no more."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.custom_derivatives import SymbolicZero
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from bodies import N
from etcfit.backend import compiled_quickly
from etcfit.model.effects import COMMANDING, EFFECTS, PAPER, AbstractEffect, State
from etcfit.model.parameters import Positive, parameters_of
from etcfit.model.stepper import Command, Step, step_between_ticks
from etcfit.model.tangents import forward, fusion_barrier, instantiated
from etcfit.model.throttle import Throttle

COUNT = 40  # states at which a step is taken
BEYOND = [effect for effect in (*EFFECTS, *COMMANDING) if effect not in PAPER]


def throttle_with(*effects: type[AbstractEffect]) -> Throttle:
    """Eqs. 1-2 and further effects at half their scales: off every bound and off value."""
    own = {
        p.symbol: p.nominal if isinstance(p.domain, Positive) else 0.5 * p.domain.scale
        for effect in effects
        for p in parameters_of(effect)
    }
    return Throttle.build((*PAPER, *effects), bodies.values(**own))


def places(throttle: Throttle) -> tuple[State, tuple[Any, ...], Step]:
    """States, memories and steps of all kinds, COUNT of each: on either stop and between, held and free, guided."""
    rng = np.random.default_rng(3)
    some = lambda low, high: rng.uniform(low, high, COUNT)  # noqa: E731
    theta = np.where(np.arange(COUNT) % 5 == 0, 0.0, some(0.0, bodies.OPEN))
    theta = np.where(np.arange(COUNT) % 7 == 0, bodies.OPEN, theta)
    x = State(some(-5.0, 5.0), theta, np.where(np.arange(COUNT) % 3 == 0, 0.0, some(-20.0, 20.0)))
    z = tuple(some(-1.0, 1.0) for _ in throttle.z0)
    mobile, circuit = (np.arange(COUNT) % 6 != 0) * 1.0, (np.arange(COUNT) % 8 != 0) * 1.0
    one, command = np.ones(COUNT), Command(*(some(0.0, 1.0) for _ in Command._fields))
    fields: dict[str, Any] = {"dt": some(1e-4, 4e-3), "voltage0": some(-12, 12), "voltage1": some(-12, 12),
                              "time": some(0.0, 2.0)}  # fmt: skip
    fields |= {"torque0": 0.1 * one, "torque1": -0.1 * one, "mobile": mobile, "circuit": circuit, "plate": one}
    fields |= {"series": 0.3 * one, "gear_ratio": N * one, "lower": 0.0 * one, "upper": bodies.OPEN * one}
    fields |= {"guide_stiffness": some(0.0, 30.0), "target0": some(0.0, 1.5), "target1": some(0.0, 1.5), "lever": one}
    return x, z, Step(**fields, command=command._replace(active=one), edge=None)


HALVES = [BEYOND[s::2] for s in (0, 1)] + [[e for k, e in enumerate(BEYOND) if k // 2 % 2 == s] for s in (0, 1)]


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param(BEYOND, id="all at once"),
        # each also without those beside it: a compilation each
        *(pytest.param(half, id=f"half {k}", marks=pytest.mark.slow) for k, half in enumerate(HALVES)),
    ],
)
def test_it_is_the_derivative_of_the_scheme_for_every_effect(effects: list[type[AbstractEffect]]) -> None:
    """`step_between_ticks.fun` is the step without its own rule: JAX differentiates every operation of it."""
    throttle = throttle_with(*effects)
    x, z, s = places(throttle)
    rng = np.random.default_rng(4)
    way = jax.tree.map(lambda leaf: rng.standard_normal(np.shape(leaf)) * 0.1, (throttle, x, z))
    pushed = jax.tree.map(lambda leaf: rng.standard_normal(COUNT), s.voltage1)

    def derivative(function: Any) -> Any:
        def one(x: State, z: Any, s: Step, dx: State, dz: Any, push: Any) -> Any:
            def along(throttle: Throttle, x: State, z: Any, voltage: Any) -> Any:
                return function(throttle, x, z, s._replace(voltage1=voltage))

            return jax.jvp(along, (throttle, x, z, s.voltage1), (way[0], dx, dz, push))

        return compiled_quickly(jax.vmap(one))(x, z, s, way[1], way[2], pushed)

    (ours, our_tangent), (theirs, their_tangent) = derivative(step_between_ticks), derivative(step_between_ticks.fun)
    assert_allclose(jnp.stack(jax.tree.leaves(ours)), jnp.stack(jax.tree.leaves(theirs)), rtol=1e-12, atol=1e-12)
    assert_allclose(
        jnp.stack(jax.tree.leaves(our_tangent)), jnp.stack(jax.tree.leaves(their_tangent)), rtol=1e-8, atol=1e-9
    )
    moving = np.abs(np.asarray(our_tangent[0].omega)) > 0.0
    assert 0.2 * COUNT < moving.sum() < COUNT  # some stick, some are held, most move


def test_forward_takes_what_does_not_move_as_a_constant() -> None:
    """d(a b) along a alone; of b, an integer index would have no tangent at all."""
    seen = []

    def product(a: Any, b: Any) -> Any:
        seen.append(isinstance(b[0], jax.Array))
        return a * b[0]

    still = (SymbolicZero(jax.typeof(jnp.float64(0.0))),)
    value, slope = forward(product, (jnp.float64(3.0), (2.0,)), (jnp.float64(1.0), still))
    assert (float(value), float(slope), seen) == (6.0, 2.0, [False])


def test_a_symbolic_zero_is_made_an_array_of_zeros() -> None:
    primal, zero = jnp.ones(3), SymbolicZero(jax.typeof(jnp.ones(3)))
    assert_array_equal(instantiated({"a": primal}, {"a": zero})["a"], np.zeros(3))
    assert instantiated(primal, primal) is primal


def test_the_barrier_changes_no_number_and_no_derivative() -> None:
    values = jnp.array([0.0, -0.0, 1.5, -jnp.inf, jnp.inf, jnp.nan, 1e-300])
    kept, slope = jax.jvp(fusion_barrier, (values,), (jnp.arange(7.0),))
    assert_array_equal(kept, values)
    assert_array_equal(slope, jnp.arange(7.0))
    assert fusion_barrier((jnp.array(True),))[0].dtype == bool
