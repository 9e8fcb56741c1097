"""A model at its optimum: its values, how well it is known, and draws from that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import results
from etcfit.estimation.fitted_model import Fitted


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """Nominal values, every coordinate known to 0.02."""
    return results.result(results.rig(tmp_path_factory.mktemp("rig"))).fitted()


def place(of: Fitted, symbol: str) -> int:
    return of.free_parameters.layout.free.index(symbol)


def test_its_values_are_those_of_its_coordinates_held_ones_and_ties_among_them(fitted: Fitted) -> None:
    layout = fitted.free_parameters.layout
    assert fitted.values["R_a"] == pytest.approx(layout.parameter("R_a").nominal)
    assert fitted.values["B_m"] == 2e-5  # fixed in rig.toml
    assert fitted.values["K_m"] == fitted.values["K_b"]
    moved = replace(fitted, x=fitted.x + 0.1 * np.eye(fitted.x.size)[place(fitted, "R_a")])
    assert moved.values["R_a"] / fitted.values["R_a"] == pytest.approx(np.exp(0.1), rel=2e-3)
    assert moved.throttle.parameter("R_a") == pytest.approx(moved.values["R_a"])
    assert moved.values["K_s"] == fitted.values["K_s"]


def test_coordinates_and_values_are_inverse_to_each_other(fitted: Fitted) -> None:
    x = fitted.x + 0.05 * np.abs(np.random.default_rng(0).standard_normal((7, fitted.x.size)))  # off the bounds
    free = fitted.free_parameters.layout.free
    each = [replace(fitted, x=row).values for row in x]
    assert_allclose(fitted.coordinates({s: np.array([v[s] for v in each]) for s in free}), x, atol=1e-8)


def test_many_models_at_once_are_each_what_they_are_alone(fitted: Fitted) -> None:
    x = fitted.x + 0.05 * np.random.default_rng(1).standard_normal((3, fitted.x.size))
    many = fitted.throttles(x)
    for symbol in ("R_a", "K_m", "T_f", "B_m"):
        alone = [replace(fitted, x=row).values[symbol] for row in x]
        assert_allclose(np.broadcast_to(np.asarray(many.parameter(symbol)), (3,)), alone, rtol=1e-12)


def test_draws_have_the_covariance_of_the_fit(fitted: Fitted) -> None:
    a, b = place(fitted, "R_a"), place(fitted, "K_b")
    covariance = fitted.covariance.copy()
    covariance[a, b] = covariance[b, a] = 0.8 * 0.02**2
    drawn = replace(fitted, covariance=covariance).laplace(20_000, np.random.default_rng(2))
    assert drawn.shape == (20_000, fitted.x.size)
    assert_allclose(drawn.mean(axis=0), fitted.x, atol=4.0 * 0.02 / np.sqrt(20_000) + 1e-12)
    assert_allclose(drawn.std(axis=0), 0.02, rtol=0.03)
    assert np.corrcoef(drawn[:, a], drawn[:, b])[0, 1] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("variance", [9.0, np.inf, np.nan])
def test_a_direction_that_is_open_is_drawn_no_wider_than_a_hundred_percent(fitted: Fitted, variance: float) -> None:
    k = place(fitted, "R_a")
    covariance = fitted.covariance.copy()
    covariance[k, k] = variance
    drawn = replace(fitted, covariance=covariance).laplace(20_000, np.random.default_rng(3))
    reach = fitted.free_parameters.layout.reach(fitted.x)[k]
    assert np.isfinite(drawn).all()
    assert drawn[:, k].std() == pytest.approx(0.0 if np.isnan(variance) else reach, rel=0.03)


def test_doubt_is_the_standard_deviation_over_the_reach(fitted: Fitted) -> None:
    k = place(fitted, "K_s")
    x, covariance = fitted.x.copy(), fitted.covariance.copy()
    x[k], covariance[k, k] = 5.0, 0.25
    of = replace(fitted, x=x, covariance=covariance)
    assert of.doubt("K_s") == pytest.approx(0.5 / 5.0)
    assert of.doubt("R_a") == pytest.approx(0.02)
    assert of.doubt("B_m") == 0.0  # fixed
    covariance[k, k] = np.nan
    assert replace(fitted, covariance=covariance).doubt("K_s") == np.inf


def test_gradients_are_those_of_differences(fitted: Fitted) -> None:
    def of(values):  # J_eq
        return 20.68**2 * values["J_m"] + values["J_L"]

    h = 1e-5
    slopes = np.asarray(fitted.gradient(of))
    assert slopes.shape == (fitted.x.size,)
    for k in range(fitted.x.size):
        up, down = (of(replace(fitted, x=fitted.x + way * h * np.eye(fitted.x.size)[k]).values) for way in (1, -1))
        assert slopes[k] == pytest.approx((up - down) / (2 * h), rel=1e-5, abs=1e-12)
