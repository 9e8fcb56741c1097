"""Compiled programs: each compiled once, however many threads ask for it, and run on every core.

A compiled loop runs on one core. Lanes of a batch and points of an ensemble are independent: shared out in pieces of
one shape they run side by side, each in a thread of its own, since neither compiling nor running holds Python's lock.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from itertools import count
from pathlib import Path
from threading import Lock, current_thread
from typing import Any, TypeVar

import jax
import numpy as np

from . import executables

# a loop of scalar operations gains nothing from XLA's third level: it takes longer to compile, and runs longer too
USUAL = {"xla_backend_optimization_level": 1}
QUICK = {"xla_backend_optimization_level": 0}  # for programs that run a few times

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
    """Begin something that compiles, and wait for nothing."""
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


_PROGRAMS: list[Program] = []
_MADE = count(1)  # programs compiled or loaded
_LOOKED_AT = 10  # of them before the mappings of memory are counted again
CROWDED = 0.3  # of all mappings that a process may have: two diagnoses, some GB


def compiled_so_far() -> dict[str, int]:
    """How many versions of each program this process has compiled, by module and function."""
    return {program.name: program.compiled for program in _PROGRAMS}


def forget() -> None:
    """Let go of everything that was compiled; what is asked for again comes from the disk (`executables.py`)."""
    for program in _PROGRAMS:
        program.forget()
    jax.clear_caches()


def _make_room() -> None:
    """Forget all before it gets too much.

    An executable holds ten to two hundred mappings of memory, a diagnosis ten thousand. Linux gives a process 65,530
    (`vm.max_map_count`), and XLA ends with a segmentation fault where it gets no more.
    """
    if next(_MADE) % _LOOKED_AT == 0 and memory_mappings() > CROWDED * most_mappings():
        forget()


def memory_mappings() -> int:
    """Of this process; 0 where the system does not tell, and has no such limit that we know of."""
    try:
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:
        return 0


@cache
def most_mappings() -> float:
    """That a process may have."""
    try:
        return float(Path("/proc/sys/vm/max_map_count").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 65530.0


class Program:
    """A function of arrays, compiled for each model and for each shape of its arguments when it is first asked for.

    Args:
        function: takes `static` hashable arguments, then arrays in any tree.
        static: how many.
        options: of XLA's compiler, for this program alone.
    """

    def __init__(self, function: Callable[..., Any], static: int = 1, options: Mapping[str, int] = USUAL) -> None:
        self.__doc__ = function.__doc__
        self.name = f"{function.__module__.rpartition('.')[-1]}.{function.__name__.lstrip('_')}"
        # what is lowered shows every argument, so that equal texts are equal programs whatever they make no use of
        self._jit = jax.jit(
            function, static_argnums=tuple(range(static)), keep_unused=True, compiler_options=dict(options)
        )
        self.__wrapped__ = function
        self._static, self._options = static, options
        self._lock = Lock()
        self._compiled: dict[Hashable, Future[Any]] = {}
        _PROGRAMS.append(self)

    def __call__(self, *args: Any) -> Any:
        return self._of(args)(*args[self._static :])

    @property
    def compiled(self) -> int:
        """How many versions were compiled: one for each model and shape of arguments."""
        return len(self._compiled)

    def ahead(self, *args: Any) -> None:
        """Compile for these arguments in the background, so that a later call with such waits less.

        An error of the compiler is raised by that call, not here.
        """
        _pool("etcfit compiling").submit(self._of, args)

    def forget(self) -> None:
        """Let go of what is compiled; what still compiles is handed to those who wait for it."""
        with self._lock:
            self._compiled = {key: future for key, future in self._compiled.items() if not future.done()}

    def text(self, *args: Any) -> str:
        """What these arguments are compiled to, as XLA prints it."""
        return self._of(args).as_text() or ""

    def _of(self, args: tuple[Any, ...]) -> Any:
        leaves, tree = jax.tree.flatten(args[self._static :])
        key = (
            args[: self._static],
            tree,
            tuple((np.shape(leaf), getattr(leaf, "dtype", type(leaf))) for leaf in leaves),
        )
        with self._lock:
            mine = key not in self._compiled
            future = self._compiled.setdefault(key, Future())
        if mine:
            try:
                future.set_result(self._made(args))
            except BaseException as error:
                with self._lock:
                    self._compiled.pop(key, None)
                future.set_exception(error)
        return future.result()

    def _made(self, args: tuple[Any, ...]) -> Any:
        """From disk where it was made before, else traced and compiled."""
        _make_room()
        static, dynamic = args[: self._static], args[self._static :]
        asked = executables.digest_asked((self.__wrapped__, self._options, *static), dynamic)
        if asked is None:
            return self._jit.lower(*args).compile()
        found = executables.find(asked, dynamic)
        return found or executables.compiled(asked, self._jit.lower(*args), dynamic, self._options)
