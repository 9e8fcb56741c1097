"""Work in processes that begin anew after a few pieces: what each compiles stays mapped, and a system has a limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

Piece = TypeVar("Piece")
Result = TypeVar("Result")


def fresh(
    work: Callable[[Piece], Result], pieces: Sequence[Piece], processes: int, each: int
) -> Iterator[tuple[Piece, Result]]:
    """Each piece and what became of it, as they are ready.

    Args:
        work: a function of a module.
        pieces: what it is given.
        processes: at a time.
        each: pieces that a process does, about, before another takes its place.
    """
    batch = processes * each
    for k in range(0, len(pieces), batch):
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:  # its max_tasks_per_child may wait for ever
            jobs = {pool.submit(work, piece): piece for piece in pieces[k : k + batch]}
            for done in as_completed(jobs):
                yield jobs[done], done.result()
