"""Two workers over one, in turns on one machine.

    python -m benchmarks.fleet.workers [--units 60] [--repeats 2] [--seed 8100]

One run that is not counted fills the cache of compiled models; then one worker and two in turns, each into a run folder
of its own. Time includes start and end of the command, which do not get faster: `work` is what is left when the time of
a fleet of two units is taken off, one for each worker.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from independent.fleet import make_fleet
from independent.line import Line

from ..runs import Failed
from .thousand import FINE
from .watched import Ended, fleet


def timed(folder: Path, out: Path, workers: int, cache: Path) -> Ended:
    """One run, printed."""
    ended = fleet(folder, out, workers, cache).end()
    if ended.status not in FINE:
        raise Failed(f"status {ended.status}: {ended.stderr}")
    print(f"{out.name}: {ended.wall:.1f} s wall, {ended.cpu:.1f} s cpu, {ended.peak.pss:.0f} MiB, "
          f"load before {ended.load:.1f}", flush=True)  # fmt: skip
    return ended


def table(units: int, walls: dict[int, list[float]], starts: dict[int, list[float]]) -> str:
    """Medians, and their ratios."""
    whole = {n: statistics.median(each) for n, each in walls.items()}
    work = {n: whole[n] - statistics.median(each) for n, each in starts.items()}
    lines = [f"| {units} units | one worker | two workers | ratio | aim |", "|---|---|---|---|---|"]
    for name, each in (("s, all of it", whole), ("s, work", work)):
        lines.append(f"| {name} | {each[1]:.1f} | {each[2]:.1f} | {each[1] / each[2]:.2f} | 1.8 |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--seed", type=int, default=8100)
    asked = parser.parse_args()
    walls: dict[int, list[float]] = {1: [], 2: []}
    starts: dict[int, list[float]] = {1: [], 2: []}
    with tempfile.TemporaryDirectory() as scratch:
        place, cache = Path(scratch), Path(scratch) / "cache"
        make_fleet(place / "all", Line(), asked.units, asked.seed)
        make_fleet(place / "two", Line(), 2, asked.seed)
        timed(place / "all", place / "not counted", 2, cache)
        for k in range(asked.repeats):
            for n in (1, 2):
                starts[n].append(timed(place / "two", place / f"start {n} {k}", n, cache).wall)
                walls[n].append(timed(place / "all", place / f"workers {n} {k}", n, cache).wall)
    print(table(asked.units, walls, starts))


if __name__ == "__main__":
    main()
