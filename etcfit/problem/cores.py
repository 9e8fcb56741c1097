"""Distribution of work over all cores.

A compiled loop runs on one core. Lanes of a batch and points of an ensemble are independent: pieces of them run in
parallel, each in its own thread, because neither compilation nor execution holds Python's lock.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import current_thread
from typing import Any, TypeVar

import jax

Piece = TypeVar("Piece")
Made = TypeVar("Made")


def _cores() -> int:
    """Number of cores for this process: ETCFIT_CORES, if several processes work in parallel; else all allowed ones."""
    given = os.environ.get("ETCFIT_CORES", "")
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return int(given) if given.isdecimal() and int(given) > 0 else allowed


CORES = _cores()
_RUNNING = "etcfit running"  # name of the threads that run programs


@cache
def _pool(purpose: str) -> ThreadPoolExecutor:
    """Threads for one purpose, so that execution does not wait for compilation."""
    return ThreadPoolExecutor(CORES, purpose)


def in_background(work: Callable[[], Any]) -> None:
    """Start a compilation without waiting for it; its error is raised where its result is needed."""
    _pool("etcfit compiling").submit(work)


def side_by_side(work: Callable[[Piece], Any], pieces: Sequence[Piece]) -> list[Any]:
    """`work` on each piece, one thread each; returns the results in order when all are computed. A piece that is itself
    divided runs in its own thread, because no other is free."""
    if len(pieces) == 1 or current_thread().name.startswith(_RUNNING):
        return [jax.block_until_ready(work(piece)) for piece in pieces]
    return list(_pool(_RUNNING).map(lambda piece: jax.block_until_ready(work(piece)), pieces))


def concurrently(work: Callable[[Piece], Made], pieces: Sequence[Piece]) -> list[Made]:
    """As `side_by_side`, for work in Python that runs programs and may itself use `side_by_side` or `concurrently`:
    Python code runs while other work compiles or computes."""
    if len(pieces) < 2 or CORES < 2:
        return [work(piece) for piece in pieces]
    with ThreadPoolExecutor(CORES, "etcfit working") as pool:
        return list(pool.map(work, pieces))
