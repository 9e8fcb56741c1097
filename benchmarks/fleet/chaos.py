"""A run that everything happens to: nothing may be lost, nothing done twice, and each broken unit named.

    python -m benchmarks.fleet.chaos [--units 100] [--workers 2] [--seed 8200] [--keep FOLDER]

Ten units of the fleet are broken, each in its own way. The command is started; when a fifth of the units is in the
store a worker process gets SIGKILL, when a half is, the client itself; all that it started must then end by itself.
The command is started again, and runs to its end. The store before and after tells whether a unit was lost, or
fitted again: a second fit has another duration. Then, with a stub for the fit, a worker whose disk is full.
"""

from __future__ import annotations

import argparse
import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from independent.fleet import WEAK_TESTS, make_fleet
from independent.line import Line

from ..runs import Failed
from .broken import BROKEN
from .found import fleet_json
from .thousand import FINE
from .watched import Watched, family, fleet


@dataclass(frozen=True)
class Check:
    """One thing that must hold."""

    what: str
    holds: bool
    found: str


def stored(run: Path) -> dict[str, float | None]:
    """Unit -> seconds of the fit that the store holds last; None for one that failed."""
    from etcfit.fleets.engine.store import Store
    from etcfit.fleets.unit import UnitResult

    ends = Store(run / "parts").ends() if (run / "parts").is_dir() else ()
    return {end.unit: end.seconds if isinstance(end, UnitResult) else None for end in ends}


def until(holds: Callable[[], bool], running: Watched, limit: float) -> None:
    """Wait for it.

    Raises:
        Failed: the command ended before, or it took too long.
    """
    deadline = time.monotonic() + limit
    while not holds():
        if running.process.poll() is not None:
            raise Failed(f"the command ended too early: {running.end().stderr}")
        if time.monotonic() > deadline:
            os.killpg(running.process.pid, signal.SIGKILL)
            raise Failed(f"waited longer than {limit:g} s")
        time.sleep(0.1)


def broken_fleet(folder: Path, units: int, seed: int) -> tuple[list[str], dict[str, str]]:
    """A fleet; names of its units, and of the broken ones with the way in which they are."""
    names = [unit.name for unit in make_fleet(folder, Line(), units, seed, tests=WEAK_TESTS).units]
    chosen = np.random.default_rng([seed, 7]).choice(units, len(BROKEN), replace=False)
    ways = {names[k]: way for k, way in zip(chosen, BROKEN, strict=True)}
    for name, way in ways.items():
        BROKEN[way](folder / name)
    return names, ways


def killed(place: Path, units: int, seed: int, workers: int, limit: float) -> list[Check]:
    """Broken folders, a worker killed, the client killed, and the command started again."""
    folder, run, cache = place / "fleet", place / "run", place / "cache"
    names, ways = broken_fleet(folder, units, seed)
    running = fleet(folder, run, workers, cache)
    until(lambda: len(stored(run)) >= units // 5, running, limit)
    victim = running.workers()[0]
    os.kill(victim, signal.SIGKILL)
    print(f"worker {victim} killed with {len(stored(run))} units done", flush=True)
    until(lambda: len(stored(run)) >= units // 2, running, limit)
    running.kill()
    running.process.wait()
    left = _left_after(running, 60.0)
    before = stored(run)
    print(f"client killed with {len(before)} units done", flush=True)
    ended = fleet(folder, run, workers, cache).end(limit)
    return [*_alone(left), *whole(run, names, ways, before, ended.status, ended.stderr)]


def _left_after(running: Watched, limit: float) -> list[int]:
    """Processes of a killed client that are still there."""
    deadline = time.monotonic() + limit
    while (left := [pid for pid in family(running.process.pid) if pid != running.process.pid]) and (
        time.monotonic() < deadline
    ):
        time.sleep(0.2)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    return left


def _alone(left: list[int]) -> list[Check]:
    return [Check("workers of a killed client end by themselves", not left, f"{len(left)} left")]


def whole(
    run: Path, names: list[str], ways: dict[str, str], before: dict[str, float | None], status: int, stderr: str
) -> list[Check]:
    """What the run folder says after the second start, against what was stored before it."""
    if status not in FINE:
        return [Check("the second start comes to its end", False, f"status {status}: {stderr}")]
    said = fleet_json(run)
    done, why = set(said["units"]), {each["unit"]: each["why"] for each in said["failed"]}
    after = stored(run)
    again = [name for name, seconds in before.items() if seconds is not None and after.get(name) != seconds]
    wrong = sorted(why.keys() ^ ways.keys())
    nameless = [name for name, text in why.items() if name not in text and "/" not in text]
    return [
        Check("the second start comes to its end", True, f"status {status}"),
        Check("every unit has a result or a reason, and not both", done | why.keys() == set(names)
              and not done & why.keys() and len(said["units"]) == len(done), f"{len(done)} and {len(why)}"),
        Check("no result that was stored is fitted again", not again, f"{len(again)} of {len(before)}"),
        Check("those that failed are the broken ones", not wrong, f"{len(why)}: "
              + (", ".join(f"{name} ({ways.get(name, 'sound')})" for name in wrong) or "each of them")),
        Check("each says what is wrong, and where", not nameless and all(map(str.strip, why.values())),
              f"{len(nameless)} do not"),
    ]  # fmt: skip


def full_disk(place: Path, workers: int) -> list[Check]:
    """The engine with a stub: one worker without room."""
    from etcfit.fleets.engine.cluster import LocalWorkers, crew
    from etcfit.fleets.engine.run import run_units
    from etcfit.fleets.engine.store import Store

    from .stubs import FullDisk

    folder = place / "full disk"
    folder.mkdir()
    names = [f"SYN{k:04d}" for k in range(60)]
    work = FullDisk(folder)
    with crew(LocalWorkers(workers)) as hands, Store(place / "parts of the full disk") as store:
        tally = run_units(names, work, hands, store, lambda what, share: None)
        ends = [end.unit for end in store.ends()]
    counted = work.counted()
    twice = [name for name, times in counted.items() if times > 1]
    return [
        Check("a worker with a full disk costs no unit", tally.fitted == len(names) and not tally.failed,
              f"{tally.fitted} fitted, {tally.failed} failed"),
        Check("each is stored once and done once", sorted(ends) == names and not twice, f"{len(twice)} twice"),
    ]  # fmt: skip


def table(checks: list[Check]) -> str:
    rows = [f"| {check.what} | {'yes' if check.holds else '**no**'} | {check.found} |" for check in checks]
    return "\n".join(["| what must hold | holds | found |", "|---|---|---|", *rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=8200)
    parser.add_argument("--limit", type=float, default=3600.0, help="s to wait for any one thing")
    parser.add_argument("--keep", type=Path, help="leave fleet and run in this folder, which must not hold any yet")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = asked.keep or Path(scratch)
        checks = killed(place, asked.units, asked.seed, asked.workers, asked.limit)
        checks += full_disk(place, asked.workers)
    print(table(checks))
    raise SystemExit(0 if all(check.holds for check in checks) else 1)


if __name__ == "__main__":
    main()
