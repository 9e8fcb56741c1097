"""A command and all the processes that it starts, with the memory that they hold together, sampled.

PSS (proportional set size) counts a page that n processes share 1/n times in each, so that the sum over processes is
what they really hold; the sum of RSS counts it n times.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..runs import ROOT, Failed

MIB = 1024.0**2


@dataclass(frozen=True)
class Memory:
    """Of several processes together, MiB."""

    pss: float = 0.0
    rss: float = 0.0
    processes: int = 0

    def largest(self, other: Memory) -> Memory:
        """Of each figure the larger."""
        return Memory(max(self.pss, other.pss), max(self.rss, other.rss), max(self.processes, other.processes))


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Args:
        status: exit status; negative: the signal that ended it.
        wall: s.
        cpu: s of all its processes that were waited for.
        peak: the most that its processes held at one time.
        client: the most that the command's own process held, MiB.
        load: of the machine before.
        stderr: what it said.
    """

    status: int
    wall: float
    cpu: float
    peak: Memory
    client: float
    load: float
    stderr: str


@dataclass
class Watched:
    """A running command, in a session of its own.

    Args:
        process: of the command itself.
        stderr: file that takes its stderr.
        begin: when it started.
        every: s between two samples of its memory.
    """

    process: subprocess.Popen[Any]
    stderr: Any
    begin: float
    load: float
    every: float = 0.5
    peak: Memory = field(default_factory=Memory)
    client: float = 0.0

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def _watch(self) -> None:
        while not self._over.wait(self.every):
            pids = family(self.process.pid)
            self.peak = self.peak.largest(held(pids))
            self.client = max(self.client, held([self.process.pid]).rss)

    def workers(self) -> list[int]:
        """Its descendants that hold the most memory, which those that fit are; the largest first."""
        pids = [pid for pid in family(self.process.pid) if pid != self.process.pid]
        return sorted(pids, key=lambda pid: -held([pid]).rss)

    def kill(self) -> None:
        """SIGKILL to the command itself, and to nothing that it started."""
        self.process.send_signal(signal.SIGKILL)

    def end(self, limit: float | None = None) -> Ended:
        """Wait for it.

        Raises:
            Failed: longer than the limit; all of it is killed.
        """
        usage: dict[str, float] = {}
        try:
            _wait(self.process, limit, usage)
        except subprocess.TimeoutExpired as error:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            raise Failed(f"longer than {limit:g} s") from error
        finally:
            self._over.set()
            self._watcher.join()
        self.stderr.seek(0)
        wall = time.time() - self.begin
        return Ended(self.process.returncode, wall, usage.get("cpu", 0.0), self.peak, self.client, self.load,
                     self.stderr.read())  # fmt: skip


def _wait(process: subprocess.Popen[Any], limit: float | None, usage: dict[str, float]) -> None:
    before = os.times()
    process.wait(limit)
    after = os.times()
    usage["cpu"] = after.children_user + after.children_system - before.children_user - before.children_system


def start(arguments: Iterable[Any], cache: Path) -> Watched:
    """`python arguments` from the project's root, with its compiled models in `cache`."""
    environment = os.environ | {"ETCFIT_CACHE": str(cache), "PYTHONPATH": str(ROOT)}
    stderr = tempfile.TemporaryFile("w+")  # noqa: SIM115  it lives as long as the process
    load, begin = os.getloadavg()[0], time.time()
    process = subprocess.Popen(
        [sys.executable, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=stderr, cwd=ROOT, env=environment,
        start_new_session=True,
    )  # fmt: skip
    return Watched(process, stderr, begin, load)


def fleet(folder: Path, out: Path, workers: int, cache: Path) -> Watched:
    """`etcfit fleet FOLDER --out OUT --workers N`."""
    return start(("-m", "etcfit.cli", "fleet", folder, "--out", out, "--workers", workers, "--quiet"), cache)


def family(root: int) -> list[int]:
    """A process, its descendants, and all in its session, whose parents may be gone."""
    parents, sessions = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:  # ended since
                continue
            parents[int(entry.name)], sessions[int(entry.name)] = int(words[1]), int(words[3])
    found = {root} | {pid for pid, session in sessions.items() if session == root}
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return sorted(found & parents.keys())


def held(pids: Iterable[int]) -> Memory:
    """What these processes hold now; one that has ended holds nothing."""
    pss = rss = 0.0
    count = 0
    for pid in pids:
        try:
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        except OSError:
            continue
        sizes = dict(line.split()[:2] for line in text.splitlines()[1:])
        pss, rss, count = pss + float(sizes["Pss:"]), rss + float(sizes["Rss:"]), count + 1
    return Memory(pss / 1024, rss / 1024, count)
