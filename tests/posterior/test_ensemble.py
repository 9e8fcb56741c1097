"""Where walkers begin, how they move, and threads that have a function computed together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.posterior import ensemble
from etcfit.posterior.ensemble import Leap, Snooker, approximate, in_step
from gaussian import Linear

LINEAR = Linear.make(size=6)


@pytest.fixture
def many_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensemble, "DRAWS_PER_COORDINATE", 400)


@pytest.mark.parametrize("wide", [0.2, 1.0, 30.0])
@pytest.mark.usefixtures("many_draws")
def test_mean_and_covariance_are_found_from_a_poor_guess(wide: float) -> None:
    sd = np.sqrt(np.diag(LINEAR.covariance))
    found = approximate(LINEAR.log_probability, LINEAR.mean + 2.0 * sd, wide**2 * np.diag(sd**2))
    assert_allclose((found.mean - LINEAR.mean) / sd, 0.0, atol=0.1)
    assert_allclose(found.root @ found.root.T / np.outer(sd, sd), LINEAR.covariance / np.outer(sd, sd), atol=0.12)


@pytest.mark.usefixtures("many_draws")
def test_roughness_does_not_hide_the_width() -> None:
    """Ripples of 0.3 in log-probability have a curvature of up to 3e5, of either sign; that of the whole is 1."""

    def rough(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum(x**2, axis=1) + 0.3 * np.sum(np.sin(1000.0 * x), axis=1)

    found = approximate(rough, np.zeros(3), 0.01 * np.eye(3))
    assert_allclose(found.root @ found.root.T, np.eye(3), atol=0.15)


def test_the_first_guess_is_kept_where_there_is_no_density_at_all() -> None:
    found = approximate(lambda x: np.full(len(x), -np.inf), np.ones(2), 4.0 * np.eye(2))
    assert_array_equal(found.mean, np.ones(2))
    assert_allclose(found.root @ found.root.T, 4.0 * np.eye(2))


@pytest.mark.usefixtures("many_draws")
def test_draws_without_density_weigh_nothing() -> None:
    def half(x: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.where(x[:, 0] > 0.0, -0.5 * np.sum(x**2, axis=1), -np.inf)

    found = approximate(half, np.zeros(2), np.eye(2))
    assert found.mean[0] == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.1)


Function = Callable[[np.ndarray], np.ndarray]


@pytest.mark.parametrize(("points", "times", "together"), [((2, 5), (3, 3), [7, 7, 7]), ((1, 1), (1, 3), [2, 1, 1])])
def test_points_of_all_jobs_are_computed_in_one_call_and_a_job_that_asks_less_often_is_not_waited_for(
    points: tuple[int, int], times: tuple[int, int], together: list[int]
) -> None:
    sizes: list[int] = []

    def function(points: np.ndarray) -> np.ndarray:
        sizes.append(len(points))
        return points[:, 0]

    def work(job: int, asked: Function) -> list[float]:
        return [float(asked(np.full((points[job], 1), 10.0 * job + k))[-1]) for k in range(times[job])]

    assert in_step(work, (0, 1), function) == [[10.0 * job + k for k in range(times[job])] for job in (0, 1)]
    assert sizes == together


@pytest.mark.parametrize("jobs", [(1,), (1, 2, 3)])
def test_an_error_of_the_function_is_raised(jobs: tuple[int, ...]) -> None:
    def function(points: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError(str(points.shape))

    with pytest.raises(ZeroDivisionError):
        in_step(lambda job, asked: asked(np.zeros((job, 1))), jobs, function)


def test_an_error_of_one_job_lets_no_other_wait_for_ever() -> None:
    def work(job: int, asked: Function) -> None:
        if job == 2:
            raise KeyError(job)
        asked(np.zeros((1, 1)))

    with pytest.raises(KeyError):
        in_step(work, (1, 2, 3), lambda points: points[:, 0])


SIZE = 5


def variances(move: Any, scale: float = 1.0, steps: int = 2000) -> np.ndarray:
    """Of each coordinate of a normal density of sd `scale`, sampled by one move alone."""
    sampler = emcee.EnsembleSampler(
        8 * SIZE, SIZE, lambda u: -0.5 * np.sum((u / scale) ** 2, axis=1), moves=move, vectorize=True
    )
    start = scale * np.random.RandomState(3).standard_normal((8 * SIZE, SIZE))
    sampler.run_mcmc(emcee.State(start, random_state=np.random.RandomState(4).get_state()), steps)
    return np.var(np.asarray(sampler.get_chain(discard=200, flat=True)), axis=0) / scale**2


@pytest.mark.parametrize("move", [Snooker(), Leap()], ids=["snooker", "leap"])
def test_a_move_keeps_the_variance_of_a_normal_density(move: Any) -> None:
    # 72 000 draws, the slowest of them with tau of about 30: standard error 0.03 each, 0.013 for their mean
    assert np.mean(variances(move, 0.6)) == pytest.approx(1.0, abs=0.04)


@pytest.mark.slow
def test_the_snooker_of_emcee_does_not_which_is_why_there_is_one_of_our_own() -> None:
    assert np.mean(variances(emcee.moves.DESnookerMove())) < 0.85
