"""Domains: the map from a coordinate to a value and back, its bounds and its slope."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from etcfit.model.parameters import DOMAINS as CLASSES
from etcfit.model.parameters import (
    AbstractDomain,
    NonNegative,
    Parameter,
    Positive,
    Real,
    log_flats,
    parameter,
    parameters_of,
)

SCALE = 2e-3
DOMAINS = [Positive(SCALE), NonNegative(SCALE), Real(SCALE)]
every = pytest.mark.parametrize("domain", DOMAINS, ids=lambda d: type(d).__name__)
COORDINATES = np.linspace(-8.0, 8.0, 161)


def values(domain: AbstractDomain, x: np.ndarray) -> np.ndarray:
    return np.asarray(jax.vmap(domain.value)(x))


@every
def test_values_come_back_from_their_coordinates(domain: AbstractDomain) -> None:
    for value in SCALE * np.geomspace(0.02, 500.0, 40):
        assert_allclose(float(domain.value(domain.coordinate(float(value)))), value, rtol=1e-9)


@every
def test_coordinates_come_back_from_their_values(domain: AbstractDomain) -> None:
    for x in np.linspace(-0.01, 6.0, 40):
        assert_allclose(domain.coordinate(float(domain.value(x))), x, rtol=1e-6, atol=1e-9)


@every
def test_values_rise_with_the_coordinate(domain: AbstractDomain) -> None:
    assert np.all(np.diff(values(domain, COORDINATES)) > 0.0)


@every
def test_the_slope_is_finite_positive_and_that_of_finite_differences(domain: AbstractDomain) -> None:
    slope = np.asarray(jax.vmap(jax.grad(domain.value))(COORDINATES))
    h = 1e-6
    difference = (values(domain, COORDINATES + h) - values(domain, COORDINATES - h)) / (2 * h)
    assert np.all(slope > 0.0)
    assert_allclose(slope, difference, rtol=1e-4, atol=1e-9 * SCALE)


@pytest.mark.parametrize("domain", [Positive(SCALE), NonNegative(SCALE)], ids=["positive", "non-negative"])
@given(x=st.floats(-1e6, 1e6))
def test_bounded_values_stay_within_their_bounds(domain: AbstractDomain, x: float) -> None:
    value = float(domain.value(x))
    assert value > 0.0
    assert math.isfinite(value)


def test_a_positive_coordinate_is_a_logarithm_near_its_scale() -> None:
    """So that a coordinate's standard error is a relative one."""
    assert_allclose(Positive(SCALE).coordinate(SCALE), 0.0, atol=1e-12)
    assert_allclose(float(jax.grad(Positive(SCALE).value)(0.0)), SCALE)
    assert_allclose(Positive(SCALE).coordinate(2.0 * SCALE), math.log(2.0), rtol=2e-3)


def test_a_non_negative_value_is_straight_away_from_zero() -> None:
    slope = jax.grad(NonNegative(SCALE).value)
    assert_allclose(float(slope(1.0)), SCALE, rtol=2e-4)
    assert_allclose(float(slope(0.0)), SCALE / 2.0)  # neither branch of the formula may lose it at the seam


@pytest.mark.parametrize("domain", [Positive(SCALE), NonNegative(SCALE)], ids=["positive", "non-negative"])
@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_a_value_on_or_beyond_its_bound_moves_just_inside(domain: AbstractDomain, bad: float) -> None:
    assert math.isfinite(domain.coordinate(bad))
    assert domain.at_bound(float(domain.value(domain.coordinate(bad))))
    inside = domain.inside(bad)
    assert 0.0 < inside <= SCALE
    assert not domain.at_bound(inside)
    assert float(jax.grad(domain.value)(domain.coordinate(inside))) > 0.1 * inside  # it still moves


@every
def test_a_value_well_inside_is_left_alone(domain: AbstractDomain) -> None:
    assert domain.inside(SCALE) == SCALE
    assert not domain.at_bound(SCALE)


def test_a_real_parameter_has_no_bound() -> None:
    assert not Real(SCALE).at_bound(0.0)
    assert Real(SCALE).inside(-5.0) == -5.0
    assert Real(SCALE).coordinate(-SCALE) == -1.0


def test_parameters_are_read_off_the_fields_in_their_order() -> None:
    @dataclasses.dataclass
    class Effect:
        memory: float
        a: float = parameter("V", Real(1.0), 0.5, "first", "here")
        b: float = parameter("A", Positive(2.0), 0.7, "second", "there")

        @classmethod
        def named(cls, p: Parameter) -> Parameter:
            return p

    assert parameters_of(Effect) == (
        Parameter("a", "V", Real(1.0), 0.5, "first", "here"),
        Parameter("b", "A", Positive(2.0), 0.7, "second", "there"),
    )


@pytest.mark.parametrize(
    ("domain", "flat", "low", "high"),
    [
        (Positive(SCALE), np.log, 0.02, 50.0),
        (NonNegative(SCALE), np.asarray, 1e-4, 3.0),
        (NonNegative(SCALE), np.asarray, 0.5, 40.0),
        (Real(SCALE), np.asarray, -2.0, 5.0),
    ],
    ids=["positive", "non-negative near zero", "non-negative", "real"],
)
def test_the_jacobian_makes_the_prior_flat_in_what_is_documented(
    domain: AbstractDomain, flat: Callable[[np.ndarray], np.ndarray], low: float, high: float
) -> None:
    """The share of the prior below a value is that of the flat quantity, by numerical integration."""
    x = np.linspace(domain.coordinate(SCALE * low), domain.coordinate(SCALE * high), 100_001)
    density = np.exp(np.asarray(jax.vmap(domain.log_flat)(x)))
    below = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(x))))
    q = flat(values(domain, x) / SCALE)
    assert_allclose(below / below[-1], (q - q[0]) / (q[-1] - q[0]), atol=5e-6)


def test_many_jacobians_at_once_are_those_of_the_domains() -> None:
    x = np.array([-1.5, -0.03, 0.4])
    kinds = np.arange(len(CLASSES))
    assert_allclose(log_flats(kinds, x), [float(c.log_flat(v)) for c, v in zip(CLASSES, x, strict=True)])
