"""Threads that ask for a function of points at the same times, and have it computed for all of them in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Lock
from typing import TypeVar

import numpy as np

from .approximation import LogProbability

Job = TypeVar("Job")
Done = TypeVar("Done")


def in_step(work: Callable[[Job, LogProbability], Done], jobs: Sequence[Job], function: LogProbability) -> list[Done]:
    """`work` on each job, one thread each; results in their order.

    Args:
        work: of a job and a function of points. One job may call it more often than another (emcee 3.1.0 splits an
            ensemble into more parts for some moves than for others): who is done is not waited for.
        jobs: each by itself.
        function: shape (K, P) -> (K,), computed for the points of all jobs that are not done together.
    """
    asked: dict[int, tuple[np.ndarray, Future[np.ndarray]]] = {}
    busy = set(range(len(jobs)))
    lock = Lock()

    def answer_if_all_wait() -> None:
        if not asked or len(asked) < len(busy):
            return
        parts, answers = zip(*(asked.pop(k) for k in sorted(asked)), strict=True)
        try:
            values = np.split(function(np.concatenate(parts)), np.cumsum([len(part) for part in parts])[:-1])
        except BaseException as error:
            for answer in answers:
                answer.set_exception(error)
            return
        for answer, value in zip(answers, values, strict=True):
            answer.set_result(value)

    def run(k: int) -> Done:
        def together(points: np.ndarray) -> np.ndarray:
            answer: Future[np.ndarray] = Future()
            with lock:
                asked[k] = points, answer
                answer_if_all_wait()
            return answer.result()

        try:
            return work(jobs[k], together)
        finally:
            with lock:
                busy.remove(k)
                answer_if_all_wait()

    with ThreadPoolExecutor(len(jobs)) as pool:
        running = [pool.submit(run, k) for k in range(len(jobs))]
    return [each.result() for each in running]
