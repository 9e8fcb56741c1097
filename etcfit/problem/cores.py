"""Work shared out to every core.

A compiled loop runs on one core. Lanes of a batch and points of an ensemble are independent: shared out in pieces they
run side by side, each in a thread of its own, since neither compiling nor running holds Python's lock.
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
    """That this process may use: ETCFIT_CORES, where several work side by side; else all that it is allowed."""
    given = os.environ.get("ETCFIT_CORES", "")
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return int(given) if given.isdecimal() and int(given) > 0 else allowed


CORES = _cores()
_RUNNING = "etcfit running"  # name of the threads that do so


@cache
def _pool(purpose: str) -> ThreadPoolExecutor:
    """Threads for one purpose, so that what runs does not queue behind what is compiled."""
    return ThreadPoolExecutor(CORES, purpose)


def in_background(work: Callable[[], Any]) -> None:
    """Begin something that compiles, and wait for nothing; its error is raised by whoever needs what it compiles."""
    _pool("etcfit compiling").submit(work)


def side_by_side(work: Callable[[Piece], Any], pieces: Sequence[Piece]) -> list[Any]:
    """`work` on each piece, one thread each; results in their order, once all are computed. A piece that is itself
    shared out is done by the thread that has it: no other is free."""
    if len(pieces) == 1 or current_thread().name.startswith(_RUNNING):
        return [jax.block_until_ready(work(piece)) for piece in pieces]
    return list(_pool(_RUNNING).map(lambda piece: jax.block_until_ready(work(piece)), pieces))


def concurrently(work: Callable[[Piece], Made], pieces: Sequence[Piece]) -> list[Made]:
    """The same for work in Python that runs programs, and may share these out by `side_by_side` or do several things
    `concurrently` itself: while one compiles or computes, another thinks."""
    if len(pieces) < 2 or CORES < 2:
        return [work(piece) for piece in pieces]
    with ThreadPoolExecutor(CORES, "etcfit working") as pool:
        return list(pool.map(work, pieces))
