"""The normal density from which walkers begin and by which they leap."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.posterior.approximation import approximate
from etcfit.posterior.settings import SamplingSettings
from gaussian import Linear

LINEAR = Linear.make(size=6)
MANY = SamplingSettings(draws_per_coordinate=400)


@pytest.mark.parametrize("wide", [0.2, 1.0, 30.0])
def test_mean_and_covariance_are_found_from_a_poor_guess(wide: float) -> None:
    sd = np.sqrt(np.diag(LINEAR.covariance))
    found = approximate(LINEAR.log_probability, LINEAR.mean + 2.0 * sd, wide**2 * np.diag(sd**2), MANY)
    assert_allclose((found.mean - LINEAR.mean) / sd, 0.0, atol=0.1)
    assert_allclose(found.root @ found.root.T / np.outer(sd, sd), LINEAR.covariance / np.outer(sd, sd), atol=0.12)


def test_roughness_does_not_hide_the_width() -> None:
    """Ripples of 0.3 in log-probability have a curvature of up to 3e5, of either sign; that of the whole is 1."""

    def rough(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum(x**2, axis=1) + 0.3 * np.sum(np.sin(1000.0 * x), axis=1)

    found = approximate(rough, np.zeros(3), 0.01 * np.eye(3), MANY)
    assert_allclose(found.root @ found.root.T, np.eye(3), atol=0.15)


def test_the_first_guess_is_kept_where_there_is_no_density_at_all() -> None:
    found = approximate(lambda x: np.full(len(x), -np.inf), np.ones(2), 4.0 * np.eye(2))
    assert_array_equal(found.mean, np.ones(2))
    assert_allclose(found.root @ found.root.T, 4.0 * np.eye(2))


def test_draws_without_density_weigh_nothing() -> None:
    def half(x: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.where(x[:, 0] > 0.0, -0.5 * np.sum(x**2, axis=1), -np.inf)

    found = approximate(half, np.zeros(2), np.eye(2), MANY)
    assert found.mean[0] == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.1)
