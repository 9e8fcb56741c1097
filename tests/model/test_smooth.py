"""Effects without a name: curves over one axis, exactly off, exact at their knots, differentiable everywhere."""

from __future__ import annotations

import inspect
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import effect_samples
from etcfit.model.effects import EFFECTS, AbstractEffect, Contribution, Inputs, State
from etcfit.model.parameters import parameters_of
from etcfit.model.smooth import UNKNOWNS, AbstractSmooth, K

UNITS = pint.UnitRegistry()
every_unknown = pytest.mark.parametrize("unknown", UNKNOWNS, ids=lambda unknown: unknown.name)
BY_NAME = {unknown.name: unknown for unknown in UNKNOWNS}


def inputs(**changes: Any) -> Inputs:
    """With a loaded gear."""
    return effect_samples.inputs(**({"motor": 0.9, "external": -0.3} | changes))


def cases(count: int) -> list[tuple[State, Inputs]]:
    """States and inputs all over every axis, and beyond its ends."""
    rng = np.random.default_rng(7)
    x = rng.uniform((-12.0, -0.2, -40.0), (12.0, 1.8, 40.0), (count, 3))
    u = rng.uniform((0.0, -2.0, -2.0), (80.0, 2.0, 2.0), (count, 3))
    near = x * (1.0, 1.0, 0.02)  # slow too: asinh bends there
    extra = [inputs(time=t, motor=m, external=e) for t, m, e in u.tolist()]
    return [(State(*row), each) for rows in (x, near) for row, each in zip(rows.tolist(), extra, strict=True)]


def made(unknown: type[AbstractSmooth], amplitudes: Any = None) -> AbstractSmooth:
    """With a curve that has no symmetry, or with the amplitudes given."""
    c = np.random.default_rng(3).uniform(0.02, 0.1, K) if amplitudes is None else amplitudes
    return unknown(**{p.symbol: v for p, v in zip(parameters_of(unknown), c, strict=True)})


def everything(c: Contribution) -> np.ndarray:
    """Every part of a contribution but the stops."""
    assert not np.isfinite(c.lower)
    assert not np.isfinite(c.upper)
    kept = [v for name, v in c._asdict().items() if name not in ("lower", "upper", "dz")]
    return jnp.stack([jnp.asarray(v, float) for v in (*kept, *c.dz)])  # pyright: ignore[reportReturnType]


def entered(unknown: type[AbstractSmooth]) -> int:
    return [name for name in Contribution._fields if name not in ("lower", "upper", "dz")].index(unknown.enters)


# ---- declarations


def test_every_smooth_effect_is_listed_and_none_is_in_the_catalogue() -> None:
    assert set(_final(AbstractSmooth)) == set(UNKNOWNS)
    assert not set(UNKNOWNS) & set(EFFECTS)


def _final(cls: type) -> list[type]:
    below = [deeper for sub in cls.__subclasses__() for deeper in _final(sub)]
    return below or [cls]


def test_names_and_symbols_are_unique_beside_the_catalogue() -> None:
    known: list[type[AbstractEffect]] = [*EFFECTS, *UNKNOWNS]
    assert len({effect.name for effect in known}) == len(known)
    symbols = [p.symbol for effect in known for p in parameters_of(effect)]
    assert len(set(symbols)) == len(symbols)


@every_unknown
def test_is_documented_with_its_source_and_named_for_what_it_does(unknown: type[AbstractSmooth]) -> None:
    assert unknown.name == f"unknown_{unknown.enters}_over_{unknown.axis}"
    text = unknown.__doc__ or ""  # its own, not inherited
    assert text != inspect.getdoc(AbstractSmooth)
    assert "Source:" in text
    assert "Differs from source:" in text


@every_unknown
def test_has_an_amplitude_at_each_knot_and_every_one_is_off_at_zero(unknown: type[AbstractSmooth]) -> None:
    parameters = parameters_of(unknown)
    assert len(parameters) == len(unknown.knots) == K == 10
    assert unknown.off == {p.symbol: 0.0 for p in parameters}
    assert np.all(np.diff(unknown.knots) > 0.0)
    assert {p.unit for p in parameters} == {unknown.unit}
    for p in parameters:
        assert p.domain.value(p.domain.coordinate(-0.3)) == pytest.approx(-0.3)  # either sign
        assert p.meaning
        assert p.source


@every_unknown
def test_units_are_those_of_what_it_enters(unknown: type[AbstractSmooth]) -> None:
    dimension = {"torque": "N*m", "friction": "N*m", "voltage": "V", "position": "rad"}[unknown.enters]
    assert UNITS.parse_units(unknown.unit) == UNITS.parse_units(dimension)
    assert UNITS.parse_units(unknown.axis_unit) is not None


@every_unknown
def test_is_told_the_load_if_it_depends_on_it(unknown: type[AbstractSmooth]) -> None:
    assert unknown.loaded == (unknown.axis == "load")


# ---- what it contributes


@every_unknown
def test_is_exactly_nothing_when_off(unknown: type[AbstractSmooth]) -> None:
    silent, loud = made(unknown, np.zeros(K)), made(unknown)
    for x, u in cases(20):
        assert_array_equal(everything(silent(x, (), u)), 0.0)
    assert all(everything(loud(x, (), u))[entered(unknown)] != 0.0 for x, u in cases(20)), "it is off"


@every_unknown
def test_enters_one_part_only(unknown: type[AbstractSmooth]) -> None:
    loud, part = made(unknown), entered(unknown)
    for x, u in cases(5):
        assert_array_equal(np.delete(everything(loud(x, (), u)), part), 0.0)


@every_unknown
def test_only_a_voltage_reaches_the_motor_alone(unknown: type[AbstractSmooth]) -> None:
    for x, u in cases(5):
        alone = everything(made(unknown)(x, (), u._replace(plate=0.0)))
        assert np.any(alone != 0.0) == (unknown.enters == "voltage")


@pytest.mark.slow
@every_unknown
def test_forward_mode_is_finite_differences(unknown: type[AbstractSmooth]) -> None:
    """With respect to every amplitude, to current, angle and speed, and to the load."""

    @jax.jit
    def at(v: Any, u: Inputs) -> Any:
        effect = made(unknown, [v[5 + k] for k in range(K)])
        return everything(effect(State(v[0], v[1], v[2]), (), u._replace(motor=v[3], external=v[4])))

    slopes = jax.jit(jax.jacfwd(at))
    for amplitudes in (np.zeros(K), np.random.default_rng(4).normal(0.0, 0.1, K)):
        for x, u in cases(5):
            point = np.array([*x, u.motor, u.external, *amplitudes])
            nudges = 1e-6 * np.eye(point.size)
            columns = [(at(point + h, u) - at(point - h, u)) / 2e-6 for h in nudges]
            exact = slopes(jnp.asarray(point), u)
            assert_allclose(exact, np.stack(columns, axis=-1), atol=1e-8)


@every_unknown
def test_has_a_finite_slope_at_rest_at_a_stop_and_without_load(unknown: type[AbstractSmooth]) -> None:
    at_rest = inputs(time=0.0, motor=0.2, external=0.2)

    def at(x: Any) -> Any:
        return everything(made(unknown)(State(x[0], x[1], x[2]), (), at_rest))

    assert np.all(np.isfinite(jax.jacfwd(at)(jnp.zeros(3))))


# ---- the curve


@every_unknown
def test_is_its_amplitude_at_each_knot(unknown: type[AbstractSmooth]) -> None:
    c = np.random.default_rng(5).normal(size=K)
    assert_allclose(made(unknown, c).shape(jnp.array(unknown.knots)), c, atol=1e-12)


@every_unknown
def test_is_linear_between_knots_and_constant_beyond(unknown: type[AbstractSmooth]) -> None:
    """Against NumPy's interpolation, in the coordinate in which the knots are equally spaced."""
    c = np.random.default_rng(6).normal(size=K)
    span = unknown.knots[-1] - unknown.knots[0]
    values = np.linspace(unknown.knots[0] - span, unknown.knots[-1] + span, 1001)
    bend = unknown.along.bend
    straight = (lambda v: np.asarray(v)) if bend is None else (lambda v: np.arcsinh(np.asarray(v) / bend))
    expected = np.interp(straight(values), straight(unknown.knots), c)
    assert_allclose(np.diff(straight(unknown.knots), 2), 0.0, atol=1e-12)
    assert_allclose(made(unknown, c).shape(jnp.array(values)), expected, atol=1e-12)


@every_unknown
def test_equal_amplitudes_are_a_constant_with_no_slope(unknown: type[AbstractSmooth]) -> None:
    """The hats sum to one: a constant has no slope, not even at a knot or at the end of the axis."""
    flat = made(unknown, np.full(K, 0.7))
    values = jnp.array([*unknown.knots, 0.0, 1e9, -1e9])
    shape, slope = jax.jvp(flat.shape, (values,), (jnp.ones_like(values),))
    assert_array_equal(shape, 0.7)
    assert_array_equal(slope, 0.0)


def test_slope_at_a_knot_is_the_mean_of_the_slopes_beside_it() -> None:
    unknown = BY_NAME["unknown_torque_over_angle"]
    c = np.zeros(K)
    c[4:6] = 1.0, 4.0
    knot = jnp.asarray(unknown.knots[4])
    _, slope = jax.jvp(made(unknown, c).shape, (knot,), (jnp.ones(()),))
    assert float(slope) == pytest.approx(9.0 * 0.5 * (1.0 + 3.0), rel=1e-9)


# ---- one value each, read off the state by its own axis

X = State(i=-1.5, theta=0.4, omega=-2.5)
READS = {
    "unknown_torque_over_angle": 0.4 / (math.pi / 2),
    "unknown_torque_over_speed": -2.5,
    "unknown_friction_over_angle": 0.4 / (math.pi / 2),
    "unknown_friction_over_speed": 2.5,
    "unknown_friction_over_load": 0.6,
    "unknown_friction_over_time": 0.4,
    "unknown_voltage_over_current": -1.5,
    "unknown_position_over_angle": 0.4 / (math.pi / 2),
}


@every_unknown
def test_reads_its_axis_off_the_state(unknown: type[AbstractSmooth]) -> None:
    effect = made(unknown)
    seen = everything(effect(X, (), inputs()))[entered(unknown)]
    assert float(seen) == pytest.approx(float(effect.shape(READS[unknown.name])), rel=1e-12)
    assert float(seen) != pytest.approx(float(effect.shape(1.1 * READS[unknown.name] + 0.01)), rel=1e-6)


@pytest.mark.parametrize(
    ("stops", "share"),
    [
        ((0.2, 1.2), 0.2),
        ((0.4, 0.4), 0.0),  # no travel at all
        ((-math.inf, math.inf), 0.5 + 0.2 / math.pi),  # an arm that turns freely: half a turn each way
        ((0.0, math.inf), 0.4 / math.pi),
    ],
)
def test_angle_is_a_share_of_the_travel_whatever_the_stops(stops: tuple[float, float], share: float) -> None:
    effect = made(BY_NAME["unknown_torque_over_angle"])
    u = inputs(lower=stops[0], upper=stops[1])
    torque, slope = jax.jvp(lambda theta: effect(X._replace(theta=theta), (), u).torque, (0.4,), (1.0,))
    assert float(torque) == pytest.approx(float(effect.shape(share)), rel=1e-9)
    assert np.isfinite(slope)


def test_friction_may_take_from_a_budget() -> None:
    """Of either sign: only the total of all effects must stay at or above zero."""
    friction = made(BY_NAME["unknown_friction_over_speed"], np.linspace(0.0, -0.1, K))(X, (), inputs()).friction
    assert -0.1 < float(friction) < 0.0


@pytest.mark.parametrize("name", [name for name in BY_NAME if "friction" in name])
def test_friction_is_the_same_in_both_directions(name: str) -> None:
    """Whichever way the plate turns, and whichever way the gear carries its load."""
    effect, u = made(BY_NAME[name]), inputs()
    back = effect(X._replace(omega=-X.omega), (), u._replace(motor=-u.motor, external=-u.external))
    assert float(back.friction) == float(effect(X, (), u).friction)
