"""Threads that ask for a function of points at the same times, and have it computed for all of them in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, BrokenBarrierError
from typing import TypeVar

import numpy as np

from .approximation import LogProbability

Job = TypeVar("Job")
Done = TypeVar("Done")


def in_step(work: Callable[[Job, LogProbability], Done], jobs: Sequence[Job], function: LogProbability) -> list[Done]:
    """`work` on each job, one thread each; results in their order.

    Args:
        work: of a job and a function of points, which it calls as many times as the work on any other job does.
        jobs: each by itself.
        function: shape (K, P) -> (K,), computed for the points of all jobs together.
    """
    asked: list[np.ndarray] = [np.empty(0)] * len(jobs)
    answers: list[np.ndarray] = []

    def compute() -> None:
        answers[:] = np.split(function(np.concatenate(asked)), np.cumsum([len(points) for points in asked])[:-1])

    meeting = Barrier(len(jobs), compute)

    def run(k: int) -> Done:
        def together(points: np.ndarray) -> np.ndarray:
            asked[k] = points
            meeting.wait()
            return answers[k]

        try:
            return work(jobs[k], together)
        except BaseException:
            meeting.abort()  # the others would wait for ever
            raise

    with ThreadPoolExecutor(len(jobs)) as pool:
        running = [pool.submit(run, k) for k in range(len(jobs))]
    errors = [each.exception() for each in running]
    for error in sorted(filter(None, errors), key=lambda error: isinstance(error, BrokenBarrierError)):
        raise error  # the first that is not of a thread which waited in vain
    return [each.result() for each in running]
