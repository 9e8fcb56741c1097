"""Every registered effect, whoever wrote it: units, domains, an exact off value, derivatives, a budget of friction."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose

from etcfit.effects import EFFECT_BY_NAME, EFFECTS, PAPER, AbstractEffect, Contribution, Inputs, State, total
from etcfit.parameters import Parameter, parameters_of

N = 20.68
UNITS = pint.UnitRegistry()
DECLARED = [(effect, p) for effect in EFFECTS for p in parameters_of(effect)]
every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
every_parameter = pytest.mark.parametrize(
    ("effect", "parameter"), DECLARED, ids=[f"{e.name}-{p.symbol}" for e, p in DECLARED]
)


def inputs(**changes: float) -> Inputs:
    fields = {"voltage": 3.0, "torque": 0.0, "time": 0.4, "plate": 1.0, "series": 0.3, "gear_ratio": N}
    return Inputs(**(fields | {"lower": 0.0, "upper": math.pi / 2} | changes))


def states(count: int = 60) -> list[State]:
    rng = np.random.default_rng(1)
    return [State(*x) for x in rng.uniform((-8.0, 0.0, -30.0), (8.0, math.pi / 2, 30.0), (count, 3))]


def made(effect: type[AbstractEffect], **changes: float) -> AbstractEffect:
    """The effect at half of its scales: off every bound and every off value."""
    typical = {p.symbol: 0.5 * getattr(p.domain, "scale", 1.0) for p in parameters_of(effect)}
    return effect(**(typical | changes))


def sums(effect: AbstractEffect, x: State, u: Inputs) -> np.ndarray:
    """Everything finite that an effect contributes, as one vector."""
    c = effect(x, effect.z0, u)
    return jnp.stack([jnp.asarray(v, float) for v in (*c[:5], *c.dz)])  # pyright: ignore[reportReturnType]


# ---- declarations


@every_effect
def test_is_documented_with_its_source_and_named(effect: type[AbstractEffect]) -> None:
    assert effect.name == effect.name.lower()
    assert EFFECT_BY_NAME[effect.name] is effect
    text = inspect.getdoc(effect) or ""
    assert "Source:" in text
    assert "Differs from source:" in text


def test_names_and_symbols_are_unique() -> None:
    assert len({e.name for e in EFFECTS}) == len(EFFECTS)
    symbols = [p.symbol for _, p in DECLARED]
    assert len(set(symbols)) == len(symbols)


@every_parameter
def test_parameter_has_unit_meaning_and_source(effect: type[AbstractEffect], parameter: Parameter) -> None:
    assert UNITS.parse_units(parameter.unit.replace("m2", "m**2")) is not None
    assert parameter.meaning.strip()
    assert parameter.source.strip()


@every_parameter
def test_parameter_survives_its_domain(effect: type[AbstractEffect], parameter: Parameter) -> None:
    """value(coordinate(v)) = v from a hundredth of the scale to a hundredfold of it."""
    domain = parameter.domain
    scale = getattr(domain, "scale", 1.0)
    for v in scale * np.geomspace(0.01, 100.0, 9):
        assert_allclose(float(domain.value(domain.coordinate(float(v)))), v, rtol=1e-9)
    inside = domain.inside(parameter.nominal)
    assert_allclose(float(domain.value(domain.coordinate(inside))), inside, rtol=1e-9, atol=1e-12 * scale)


# ---- what it contributes


@every_effect
def test_is_off_at_its_off_value(effect: type[AbstractEffect]) -> None:
    """Exactly nothing, so that models nest; those of Eqs. 1-2 are never off."""
    if effect in PAPER:
        assert effect.off is None
        return
    assert effect.off is not None, "an effect beyond Eqs. 1-2 needs a value at which it vanishes"
    assert set(effect.off) <= {p.symbol for p in parameters_of(effect)}
    silent, loud = made(effect, **effect.off), made(effect)
    for x in states():
        c = silent(x, silent.z0, inputs())
        assert [float(v) for v in c[:5]] == [0.0] * 5
        assert not np.isfinite(c.lower)
        assert not np.isfinite(c.upper)
    assert any(np.any(sums(loud, x, inputs()) != 0.0) for x in states()), "it is always off"


@every_effect
def test_friction_is_a_budget(effect: type[AbstractEffect]) -> None:
    assert all(float(made(effect)(x, effect.z0, inputs()).friction) >= 0.0 for x in states())


@every_effect
def test_memory_and_rates_match(effect: type[AbstractEffect]) -> None:
    assert len(made(effect)(states(1)[0], effect.z0, inputs()).dz) == len(effect.z0)


@every_effect
def test_forward_mode_is_finite_differences(effect: type[AbstractEffect]) -> None:
    """With respect to every parameter and to current, angle and speed."""
    symbols = [p.symbol for p in parameters_of(effect)]
    typical = np.array([0.5 * getattr(p.domain, "scale", 1.0) for p in parameters_of(effect)])

    def at(v: np.ndarray) -> np.ndarray:
        parameters = dict(zip(symbols, v[3:], strict=True))
        return sums(effect(**parameters), State(v[0], v[1], v[2]), inputs())

    for x in states(5):
        point = np.array([*x, *typical])
        nudges = np.diag(1e-6 * np.maximum(np.abs(point), 1e-9))
        columns = [(at(point + h) - at(point - h)) / (2.0 * h.sum()) for h in nudges]
        scale = 1.0 + np.abs(at(point)).max() / np.abs(point)
        exact = np.asarray(jax.jacfwd(at)(jnp.asarray(point)))
        assert_allclose(exact / scale, np.stack(columns, axis=-1) / scale, atol=1e-7)


@every_effect
def test_a_motor_alone_feels_nothing_of_the_plate(effect: type[AbstractEffect]) -> None:
    """With the gear apart the angle means nothing: no effect may depend on it, nor stop it."""
    apart, x = inputs(plate=0.0), states(1)[0]
    elsewhere = State(x.i, x.theta + 0.7, x.omega)
    assert_allclose(sums(made(effect), x, apart), sums(made(effect), elsewhere, apart), rtol=1e-14)
    c = made(effect)(x, effect.z0, apart)
    assert not np.isfinite(c.lower)
    assert not np.isfinite(c.upper)


@pytest.mark.parametrize("name", ["return_spring", "gravity_load"])
def test_a_spring_returns_what_it_took(name: str) -> None:
    """The work over a closed path is zero: sum torque dtheta from 0 to open and back, at whatever speed."""
    effect = made(EFFECT_BY_NAME[name])
    there = np.linspace(0.0, math.pi / 2, 2001)
    theta = np.concatenate((there, there[::-1]))
    omega = np.concatenate((np.full(2001, 3.0), np.full(2001, -0.2)))
    torque = np.array(jax.vmap(lambda th, w: effect(State(0.0, th, w), (), inputs()).torque)(theta, omega))
    work = np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(theta))
    assert abs(work) < 1e-12
    assert np.ptp(torque) > 0.01


# ---- closed forms: one value each

AT = State(2.0, 0.5, -3.0)
CLOSED: Mapping[str, tuple[dict[str, float], dict[str, Any]]] = {
    "armature": (
        {"R_a": 1.5, "L_a": 2e-3, "K_b": 0.02, "K_m": 0.03},
        {"voltage": -1.8 * 2.0 + 0.02 * N * 3.0, "torque": N * 0.03 * 2.0, "inductance": 2e-3},
    ),
    "inertia": ({"J_m": 1e-6, "J_L": 5e-4}, {"inertia": N**2 * 1e-6 + 5e-4}),
    "viscous_friction": ({"B_m": 1e-5, "B_L": 2e-3}, {"torque": 3.0 * (N**2 * 1e-5 + 2e-3)}),
    "return_spring": ({"K_s": 0.2, "T_PL": 0.3}, {"torque": -0.4}),
    "coulomb_friction": ({"T_f": 0.25}, {"friction": 0.25}),
    "end_stops": ({}, {"lower": 0.0, "upper": math.pi / 2}),
    "gravity_load": ({"T_g": 0.6}, {"torque": -0.6 * math.sin(0.5)}),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_form(name: str) -> None:
    parameters, expected = CLOSED[name]
    assert_allclose(EFFECT_BY_NAME[name](**parameters)(AT, (), inputs())[:7], Contribution(**expected)[:7], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("inertia", {"inertia": N**2 * 1e-6}),
        ("viscous_friction", {"torque": 3.0 * N**2 * 1e-5}),
        ("return_spring", {}),
        ("coulomb_friction", {}),
        ("end_stops", {}),
        ("gravity_load", {}),
    ],
)
def test_closed_form_of_the_motor_alone(name: str, expected: dict[str, Any]) -> None:
    parameters, _ = CLOSED[name]
    c = EFFECT_BY_NAME[name](**parameters)(AT, (), inputs(plate=0.0))
    assert_allclose(c[:7], Contribution(**expected)[:7], rtol=1e-12, atol=0.0)


def test_the_paper_has_a_closed_form_each() -> None:
    assert {effect.name for effect in PAPER} <= set(CLOSED)


def test_total_adds_torques_and_takes_the_tightest_stop() -> None:
    a = Contribution(torque=1.0, friction=0.1, voltage=2.0, lower=0.1, dz=(5.0,))
    b = Contribution(torque=-3.0, inertia=4.0, lower=-1.0, upper=2.0, dz=(6.0, 7.0))
    c = total([a, b])
    assert [float(v) for v in c[:7]] == [-2.0, 0.1, 2.0, 4.0, 0.0, 0.1, 2.0]
    assert c.dz == (5.0, 6.0, 7.0)
