"""Threads that have a function computed together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from etcfit.posterior.in_step import in_step

Function = Callable[[np.ndarray], np.ndarray]


def test_points_of_all_jobs_are_computed_in_one_call() -> None:
    sizes: list[int] = []

    def function(points: np.ndarray) -> np.ndarray:
        sizes.append(len(points))
        return points[:, 0]

    def work(job: int, asked: Function) -> list[float]:
        return [float(asked(np.full((job, 1), float(job + k)))[-1]) for k in range(3)]

    assert in_step(work, (2, 5), function) == [[2.0, 3.0, 4.0], [5.0, 6.0, 7.0]]
    assert sizes == [7, 7, 7]


def test_a_job_that_asks_less_often_is_not_waited_for() -> None:
    sizes: list[int] = []

    def function(points: np.ndarray) -> np.ndarray:
        sizes.append(len(points))
        return points[:, 0]

    def work(job: int, asked: Function) -> list[float]:
        return [float(asked(np.full((1, 1), float(job + k)))[0]) for k in range(job)]

    assert in_step(work, (1, 3), function) == [[1.0], [3.0, 4.0, 5.0]]
    assert sizes == [2, 1, 1]


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
