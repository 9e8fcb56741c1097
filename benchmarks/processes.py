"""Work in processes that begin anew after a few pieces: what each compiles stays mapped, and a system has a limit."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

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


def resumed(
    work: Callable[[int], dict[str, Any]], seeds: Sequence[int], processes: int, each: int, out: Path | None
) -> dict[int, dict[str, Any]]:
    """What became of rigs by their seed, those of an earlier run that a file holds among them; told and kept as made.

    Args:
        work: a function of a module, from a seed to figures, `seconds` among them.
        seeds: wanted.
        processes, each: see `fresh`.
        out: every figure, JSON; None to keep nothing.
    """
    rigs: dict[int, dict[str, Any]] = {}
    if out and out.is_file():
        rigs = {int(seed): rig for seed, rig in json.loads(out.read_text()).items()}
    for seed, rig in fresh(work, [s for s in seeds if s not in rigs], processes, each):
        rigs[seed] = rig
        if out:
            out.write_text(json.dumps(rigs, indent=1))
        print(f"rig {seed}: {rig['seconds']:.1f} s", file=sys.stderr, flush=True)
    return rigs
