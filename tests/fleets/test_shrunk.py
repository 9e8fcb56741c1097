"""Shrunk units: the closed form, the joint Gaussian by brute force, and what shrinking is worth."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fleet_statistics import NO_PROFILES, Design, draw, shrinkage
from etcfit.fleets.statistics.population import population
from etcfit.fleets.statistics.shrunk import shrink
from etcfit.fleets.statistics.stack import Stack


def test_the_closed_form() -> None:
    drawn = draw(Design(30, 4, 1.0), 1)
    of = population(drawn.stack, settings=NO_PROFILES)
    found = shrink(drawn.stack, of)
    prior = np.linalg.inv(of.covariance)
    for u in range(30):
        f = drawn.stack.information[u]
        covariance = np.linalg.inv(f + prior)
        expected = covariance @ (f @ drawn.stack.estimate[u] + prior @ of.mean)
        np.testing.assert_allclose(found.estimate[u] / drawn.mean, expected / drawn.mean, rtol=1e-8)
        np.testing.assert_allclose(found.covariance[u] / np.outer(drawn.sd, drawn.sd),
                                   covariance / np.outer(drawn.sd, drawn.sd), atol=1e-8)  # fmt: skip


def test_the_joint_gaussian_of_all_units_and_the_mean() -> None:
    drawn = draw(Design(6, 2, 1.0), 2)
    of = population(drawn.stack, settings=NO_PROFILES)
    found = shrink(drawn.stack, of)
    # all theta_u and mu in one vector, mu with a flat prior: precision by hand
    precision, right = np.zeros((14, 14)), np.zeros(14)
    prior = np.linalg.inv(of.covariance)
    for u in range(6):
        one, mu = slice(2 * u, 2 * u + 2), slice(12, 14)
        precision[one, one] += drawn.stack.information[u] + prior
        precision[one, mu] -= prior
        precision[mu, one] -= prior
        precision[mu, mu] += prior
        right[one] += drawn.stack.information[u] @ drawn.stack.estimate[u]
    scale = np.tile(drawn.sd, 7)
    joint = np.linalg.inv(precision * np.outer(scale, scale))
    mean = scale * (joint @ (scale * right))
    np.testing.assert_allclose(
        found.estimate.ravel() / np.tile(drawn.mean, 6), mean[:12] / np.tile(drawn.mean, 6), rtol=1e-6
    )
    np.testing.assert_allclose(found.stderr.ravel(), (scale * np.sqrt(np.diag(joint)))[:12], rtol=1e-6)
    np.testing.assert_allclose(of.mean_covariance, (joint * np.outer(scale, scale))[12:, 12:], rtol=1e-6)


def test_a_unit_without_data_is_the_mean_and_a_shared_symbol_the_common_value() -> None:
    drawn = draw(Design(30, 3, 0.3), 3)
    of = population(drawn.stack, shared=["s_2"], settings=NO_PROFILES)
    nothing = Stack(("new",), drawn.stack.symbols, 7.0 * drawn.mean[None], np.zeros((1, 3, 3)))
    found = shrink(nothing, of)
    np.testing.assert_allclose(found.estimate[0], of.mean, rtol=1e-12)
    np.testing.assert_allclose(found.covariance[0], of.covariance, rtol=1e-9, atol=1e-12 * float(drawn.mean.min()) ** 2)
    known = shrink(drawn.stack, of)
    np.testing.assert_allclose(known.estimate[:, 2], of.mean[2], rtol=1e-12)
    np.testing.assert_allclose(known.stderr[:, 2], np.sqrt(of.mean_covariance[2, 2]), rtol=1e-9)


def test_units_without_a_symbol_of_the_population_are_refused() -> None:
    drawn = draw(Design(10, 2, 0.3), 4)
    other = Stack(("x",), ("s_0",), np.ones((1, 1)), np.ones((1, 1, 1)))
    with pytest.raises(ValueError, match="the population has s_1"):
        shrink(other, population(drawn.stack, settings=NO_PROFILES))


@pytest.mark.parametrize(("weak", "most"), [(3.0, 0.8), (1.0, 0.9), (0.05, 1.02)])
def test_shrinking_helps_weak_units_and_does_not_harm_strong_ones(weak: float, most: float) -> None:
    assert shrinkage(Design(40, 3, weak), 3, 1000) <= most


@pytest.mark.slow
@pytest.mark.parametrize("symbols", [4, 10])
@pytest.mark.parametrize(("weak", "most"), [(3.0, 0.8), (2.0, 0.8), (0.3, 1.02), (0.1, 1.02), (0.03, 1.02)])
def test_with_a_dozen_units_too(symbols: int, weak: float, most: float) -> None:
    assert shrinkage(Design(12, symbols, weak), 30, 1000) <= most
