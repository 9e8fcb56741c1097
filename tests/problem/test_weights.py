"""What conditions weights: each function by hand on a small problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from measurements import CONFIG, measurement, prepared

T = np.arange(6) * 1e-3
ANGLE = np.array([0.1, 0.1, 0.3, 0.3, 0.3, 0.2])


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    trace = prepared(measurement("response", T, {"voltage": 0 * T, "position": ANGLE}))
    return EstimationProblem.of_traces(CONFIG, free_parameters(CONFIG), (trace,))


def placed(problem: EstimationProblem, array: np.ndarray) -> np.ndarray:
    """The samples of the only trace, shape (n,)."""
    lane, _, marks = problem.batch.places[0]
    return np.asarray(array)[marks, lane, 0]


def test_free_running_weighs_each_sample_by_its_own_noise(problem: EstimationProblem) -> None:
    filter_ = weights.free_running(problem)
    assert_allclose(placed(problem, filter_.weight), 1.0 / placed(problem, problem.sigma))
    assert np.count_nonzero(filter_.weight) == T.size
    assert not np.any(filter_.gain)


def test_filters_without_dynamics_share_zeros_that_take_no_memory(problem: EstimationProblem) -> None:
    one, other = weights.free_running(problem), weights.forgiving(problem)
    assert one.transition is other.transition
    assert one.sense is other.gain
    assert one.gain.strides == (0, 0, 0, 0)
    assert not np.any(one.transition)


def test_forgiving_adds_half_the_distance_to_the_farthest_neighbour(problem: EstimationProblem) -> None:
    sigma = placed(problem, problem.sigma)
    near = np.array([0.0, 0.2, 0.2, 0.0, 0.1, 0.1])
    assert_allclose(placed(problem, weights.forgiving(problem).weight), 1.0 / np.hypot(sigma, 0.5 * near))
    wide = np.array([0.2, 0.2, 0.2, 0.2, 0.1, 0.1])  # two samples either way
    assert_allclose(placed(problem, weights.forgiving(problem, 2e-3).weight), 1.0 / np.hypot(sigma, 0.5 * wide))


def test_an_outlier_is_weighed_down_and_nothing_else(problem: EstimationProblem) -> None:
    r = np.array([1.0, -1.0, 0.5, -0.5, 50.0, 0.8])[:, None]
    weighed, count = weights.outliers_weighed(problem, [r])
    spread = 1.4826 * 0.9
    excess = placed(problem, weighed.sigma) / placed(problem, problem.sigma)
    assert count == 1
    assert_allclose(excess, [1.0, 1.0, 1.0, 1.0, 50.0 / (5.0 * spread), 1.0])
    again, _ = weights.outliers_weighed(weighed, [r])
    assert_array_equal(again.sigma, weighed.sigma)  # from the declared noise, however often


def test_a_channel_counts_for_no_more_than_its_error_allows(
    problem: EstimationProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    off = np.array(problem.slots.value) + 7.0 * np.array(problem.sigma)
    monkeypatch.setattr(EstimationProblem, "simulated", lambda *_: off)
    discounted = weights.discounted(problem, np.zeros(1))
    assert_allclose(placed(problem, discounted.sigma), 7.0 * placed(problem, problem.sigma))


@pytest.mark.parametrize("jitter", [0.1, 0.02, 0.0])
@pytest.mark.parametrize("square", [0.0, 1.0, 3.0])
def test_jitter_goes_half_way_to_its_mean_with_a_small_one_expected(
    problem: EstimationProblem, monkeypatch: pytest.MonkeyPatch, square: float, jitter: float
) -> None:
    """Every q is 1000."""
    weight = np.array(problem.slots.weight)
    share = 1e3 * weight
    monkeypatch.setattr(EstimationProblem, "filter_and_timing", lambda *_: (None, share))
    before = replace(problem, jitter=jitter)
    r = np.sqrt(square) * weight
    likeliest, error = jitter**2 + 1e-3 * (square - 1.0), 1e-3 * np.sqrt(2.0 / weight.sum())
    a = np.linspace(0.0, 0.05, 2_000_001)
    p = np.exp(-0.5 * ((a - likeliest) / error) ** 2 - a / 0.02**2)
    mean = np.sum(a * p) / np.sum(p)
    assert_allclose(weights.timed(before, np.zeros(1), r).jitter, np.sqrt(0.5 * (jitter**2 + mean)), rtol=1e-3)
    monkeypatch.setattr(EstimationProblem, "filter_and_timing", lambda *_: (None, 1e-3 * share))
    assert weights.timed(before, np.zeros(1), r) is before  # nothing changes fast enough to tell
