"""Commands timed from without: each a fresh Python, what it took told by the system when it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from .stages import BEGIN

ROOT = Path(__file__).resolve().parents[1]
DATA = "ETCFIT_DATA"  # in the environment: where copies of public data sets lie


class Failed(RuntimeError):
    """What could not be done, and why: a process that took too long, or ended with another status than it should."""


class Skipped(Failed):
    """What this machine has not got the means for."""


@dataclass(frozen=True)
class Run:
    """One process: wall and CPU time (s), largest resident set (MiB), what it printed, the machine's load before."""

    wall: float
    cpu: float
    peak: float
    stdout: str
    load: float

    def __str__(self) -> str:
        return f"{self.wall:6.1f} s wall {self.cpu:6.1f} s cpu {self.peak:6.0f} MiB   load before {self.load:.1f}"


def run(
    arguments: Iterable[Any],
    cache: Path,
    tree: Path = ROOT,
    limit: float | None = None,
    core: int | None = None,
    accepted: Collection[int] = (0,),
) -> Run:
    """`python arguments`, from start to end.

    Args:
        arguments: of Python: `-m module ...`.
        cache: where its compiled models are kept.
        tree: whose packages it imports.
        limit: s after which it is ended.
        core: the one that it may run on; all, if None.
        accepted: exit statuses that are a success.
    Raises:
        Failed: another exit status, or the limit.
    """
    pinned = [] if core is None else ["taskset", "-c", str(core)]
    command = [*pinned, sys.executable, *map(str, arguments)]
    load, begin = os.getloadavg()[0], time.time()
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as told:
        process = subprocess.Popen(
            command, stdout=out, stderr=told, cwd=tree, env=_environment(cache, tree, begin), start_new_session=True
        )
        usage = _ended(process, limit)
        wall = time.time() - begin
        stdout, stderr = _whole(out), _whole(told)
    if process.returncode not in accepted:
        late = limit is not None and wall >= limit
        failed = Failed(f"longer than {limit:g} s" if late else f"status {process.returncode}: {_last_line(stderr)}")
        failed.add_note(f"{' '.join(command)}\n{stderr}")
        raise failed
    return Run(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0, stdout, load)


def _environment(cache: Path, tree: Path, begin: float) -> dict[str, str]:
    own = {"ETCFIT_CACHE": str(cache), "PYTHONPATH": str(tree), BEGIN: str(begin)}
    if data := os.environ.get(DATA):
        own[DATA] = str(Path(data).resolve())  # seen from here, not from the tree
    return {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"} | own


def _ended(process: subprocess.Popen[Any], limit: float | None) -> Any:
    """What the process used; it is killed, with what it started, at the limit or when we are interrupted."""

    def kill() -> None:
        os.killpg(process.pid, signal.SIGKILL)

    timer = threading.Timer(limit or 0.0, kill)
    if limit is not None:
        timer.start()
    try:
        _, status, usage = os.wait4(process.pid, 0)  # of this process alone, unlike RUSAGE_CHILDREN
    except BaseException:
        kill()
        raise
    finally:
        timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage


def _whole(file: IO[str]) -> str:
    file.seek(0)
    return file.read()


def _last_line(text: str) -> str:
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "no word on stderr")


@contextmanager
def busy() -> Iterator[None]:
    """Another process beside, that keeps a core busy."""
    with subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) as spinning:
        try:
            yield
        finally:
            spinning.kill()
