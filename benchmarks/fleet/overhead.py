"""What the engine itself costs a unit: many units whose fit costs nothing.

    python -m benchmarks.fleet.overhead [--units 1000 10000 100000] [--workers 2]

Each size in a process of its own, with real worker processes and the store on disk. `ms a unit` is wall time of
`run_units` over units, all that client, scheduler and workers do in it included, the writing of results too; the start
of the workers is told apart. `again` is the same fleet once more, when every stored result still holds. Memory is the
client's resident set: before, and the largest while it ran; it must not grow with the units beyond their names.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from ..processes import fresh
from .watched import held


@dataclass(frozen=True)
class Cost:
    """Of one size.

    Args:
        begin: s until the workers were there.
        first, again: s of `run_units`, and of the same once more.
        read: s to read all results back.
        before, peak: resident set of the client, MiB.
        store: of RUN/parts, MiB.
    """

    units: int
    begin: float
    first: float
    again: float
    read: float
    before: float
    peak: float
    store: float


class Peak:
    """with Peak() as peak: the largest resident set of this process, sampled."""

    def __enter__(self) -> Peak:
        self._over, self.rss = threading.Event(), _own()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._watcher.join()

    def _watch(self) -> None:
        while not self._over.wait(0.2):
            self.rss = max(self.rss, _own())


def _own() -> float:
    import os

    return held([os.getpid()]).rss


def cost(piece: tuple[int, int]) -> Cost:
    """Of so many units on so many workers."""
    from etcfit.fleets.engine.cluster import LocalWorkers, crew
    from etcfit.fleets.engine.run import run_units
    from etcfit.fleets.engine.store import Store

    from .stubs import NoFit

    count, workers = piece
    names = [f"SYN{k:07d}" for k in range(count)]
    with tempfile.TemporaryDirectory() as scratch:
        parts = Path(scratch) / "parts"
        start = time.perf_counter()
        with crew(LocalWorkers(workers)) as hands:
            begin, before = time.perf_counter() - start, _own()
            walls = []
            with Peak() as peak:
                for expected in ((count, 0), (0, count)):
                    start = time.perf_counter()
                    with Store(parts) as store:
                        tally = run_units(names, NoFit(), hands, store, _silent)
                    walls.append(time.perf_counter() - start)
                    if (tally.fitted, tally.unchanged) != expected:
                        raise AssertionError(f"{tally}, expected {expected} fitted and unchanged")
                start = time.perf_counter()
                with Store(parts) as store:
                    back = sum(1 for _ in store.ends())
                read = time.perf_counter() - start
            if back != count:
                raise AssertionError(f"{back} results of {count} units")
        return Cost(count, begin, walls[0], walls[1], read, before, peak.rss, store.path.stat().st_size / 2**20)


def _silent(what: str, share: float) -> None:
    """No progress."""


def table(costs: list[Cost]) -> str:
    heads = ("units", "start s", "first s", "ms a unit", "again s", "ms a unit again", "read back s",
             "client MiB before", "client MiB largest", "store MiB")  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for c in sorted(costs, key=lambda c: c.units):
        cells = (f"{c.units}", f"{c.begin:.1f}", f"{c.first:.1f}", f"{1e3 * c.first / c.units:.3f}", f"{c.again:.1f}",
                 f"{1e3 * c.again / c.units:.3f}", f"{c.read:.1f}", f"{c.before:.0f}", f"{c.peak:.0f}",
                 f"{c.store:.1f}")  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    costs = []
    for _, each in fresh(cost, [(units, asked.workers) for units in asked.units], 1, 1):
        costs.append(each)
        print(f"{each.units}: {each.first:.1f} s", flush=True)
    print(table(costs))


if __name__ == "__main__":
    main()
