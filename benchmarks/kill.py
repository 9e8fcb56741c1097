"""Commands stopped at random moments: nothing may be lost, mixed or stale, and the same command again ends as ever.

    python -m benchmarks.kill [--moments 20] [--commands fit diagnose design fleet] [--seed 36] [--keep FOLDER]

One unit of a synthetic line is measured, fitted, diagnosed and designed for, and then once more with one trace more:
that is what the commands are stopped at, so that old results lie in their way. SIGKILL goes to the command alone, as
the system sends it; SIGINT to its whole group, as Ctrl-C does. A third of the moments each is drawn from the whole
duration, from its last fifth, and from the tenth of a second after the command has begun to write its files.

Then the run folder must say of itself that each stage on its manifest is whole and made from what lies there; the
stage that was stopped is the old one or the new one, file by file; and none is gone that is not in superseded/. The
command is started again, and what it leaves is compared with what an undisturbed one leaves, byte by byte (of the
manifest without times; of a fleet without the seconds of its fits).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from etcfit.errors import UsageError
from etcfit.run_folder.manifest import MANIFEST, STAGE_FILES, SUPERSEDED, is_current, read_records
from independent.fleet import make_fleet
from independent.line import Line

from .fleet.watched import Watched, family, start
from .runs import Failed

LIMIT = 1800.0  # s that any one command may take
FINE = (0, 3)  # exit statuses of a command that came to its end
SIGNALS = (signal.SIGKILL, signal.SIGINT)
PARTS = ("anywhere", "late", "writing")  # of the duration, from which moments are drawn
_LATE, _WRITING = 0.8, 0.1


@dataclass(frozen=True)
class Case:
    """A command, and what lies there before it.

    Args:
        name: of the stage, or fleet.
        words: of the command line, from the run folder.
        before: the run folder as it finds it; copied each time.
    """

    name: str
    words: Callable[[Path], tuple[Any, ...]]
    before: Path | None


@dataclass
class Tally:
    """What came of the moments at which one command was stopped."""

    seconds: float
    stopped: dict[str, int] = field(default_factory=lambda: {each.name: 0 for each in SIGNALS})
    ended_before: int = 0
    faults: dict[str, list[str]] = field(
        default_factory=lambda: {kind: [] for kind in ("lost", "mixed", "stale", "left behind", "differs")}
    )

    def note(self, kind: str, what: str) -> None:
        self.faults[kind].append(what)
        print(f"    {kind}: {what}", flush=True)


def prepared(place: Path) -> tuple[Path, Path, Path]:
    """A fleet of six units, one of them as a measurement folder, and the same without one trace."""
    if (place / "less").is_dir():
        return place / "line", place / "rig", place / "less"
    make_fleet(place / "line", Line(), 6, 3600, own_rig_toml=True)
    unit = sorted(path for path in (place / "line").iterdir() if path.is_dir())[0]
    shutil.copytree(unit, place / "rig")
    shutil.copytree(unit, place / "less")
    sorted((place / "less" / "response").glob("*.csv"))[-1].unlink()
    return place / "line", place / "rig", place / "less"


def cases(place: Path, cache: Path, wanted: Sequence[str]) -> Iterator[Case]:
    """The commands wanted, with old results in their way."""
    line, rig, less = prepared(place)
    if "fleet" in wanted:
        yield Case("fleet", lambda run: ("fleet", line, "--out", run, "--workers", 2), None)
    if "fit" in wanted:
        yield Case("fit", lambda run: ("fit", rig, "--out", run), _finished(less, place / "old", cache))
    for name in ("diagnose", "design"):
        if name in wanted:
            yield Case(name, lambda run, name=name: (name, run), _finished(less, place / "old", cache))


def _finished(rig: Path, run: Path, cache: Path) -> Path:
    """A run folder with a fit, a diagnosis and gains; what is done is not done again."""
    through(("run", rig, "--out", run, "--until", "design"), cache)
    return run


def begun(words: tuple[Any, ...], cache: Path) -> Watched:
    return start(("-m", "etcfit.cli", *words, "--quiet"), cache)


def through(words: tuple[Any, ...], cache: Path) -> float:
    """Run a command to its end; s.

    Raises:
        Failed: it did not come to one.
    """
    ended = begun(words, cache).end(LIMIT)
    if ended.status not in FINE:
        raise Failed(f"{' '.join(map(str, words))}: status {ended.status}: {ended.stderr}")
    return ended.wall


def copied(case: Case, run: Path) -> Path:
    if run.exists():  # of an earlier time
        shutil.rmtree(run)
    if case.before is not None:
        shutil.copytree(case.before, run)
    return run


def stopped(running: Watched, run: Path, part: str, share: float, seconds: float, how: signal.Signals) -> bool:
    """Whether a command was stopped before it came to its end by itself."""
    if part == "writing":
        while running.process.poll() is None and not _writes(run):
            time.sleep(0.002)
        time.sleep(_WRITING * share)
    else:
        first = _LATE if part == "late" else 0.0
        time.sleep(max(0.0, seconds * (first + (1.0 - first) * share)))
    if running.process.poll() is None:
        if how == signal.SIGKILL:
            running.kill()
        else:
            os.killpg(running.process.pid, how)
    ended = running.end(LIMIT)
    _wait_for(lambda: len(family(running.process.pid)) == 0)
    return ended.status not in FINE


def _writes(run: Path) -> bool:
    return run.is_dir() and any(path.name.startswith((".draft-", ".done")) for path in run.iterdir())


def _wait_for(holds: Callable[[], bool], limit: float = 60.0) -> None:
    deadline = time.monotonic() + limit
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.05)


def look(case: Case, run: Path, undisturbed: Path, tally: Tally, moment: str) -> None:
    """What lies in a run folder after a command was stopped."""
    if case.name == "fleet":
        return  # its results lie in the store, which the second start reads; what it leaves is compared there
    old = read_records(case.before) if case.before is not None else {}
    try:
        now = read_records(run)  # puts in place what counts, as the next command would
    except UsageError as error:
        tally.note("mixed", f"{moment}: {error}")
        return
    new = read_records(undisturbed)
    for stage in now:
        if not is_current(run, stage, now):
            tally.note("stale", f"{moment}: {stage}")
    ends = [records[case.name].outputs for records in (old, new) if case.name in records]
    if case.name not in now or now[case.name].outputs not in ends:
        tally.note("mixed", f"{moment}: {case.name} is neither the old one nor the new one")
    for stage in old.keys() - now.keys():
        if not all((run / SUPERSEDED / name).is_file() for name, sha in old[stage].outputs.items() if sha):
            tally.note("lost", f"{moment}: {stage}")


def contents(run: Path) -> dict[str, Any]:
    """All that a command left, without what must differ: times, and what the old results left in superseded/."""
    names = {path.relative_to(run).as_posix(): path for path in run.rglob("*") if path.is_file()}
    kept = {name: path for name, path in names.items() if not name.startswith((f"{SUPERSEDED}/", "parts/"))}
    out: dict[str, Any] = {name: path.read_bytes() for name, path in kept.items() if path.suffix == ".png"}
    for name in kept.keys() - out.keys():
        out[name] = _without_times(kept[name])
        if kept[name].suffix == ".txt":  # it names the folder
            out[name] = out[name].replace(str(run).encode(), b"RUN")
    return out


def _without_times(path: Path) -> Any:
    if path.name == MANIFEST:
        stages = json.loads(path.read_bytes())["stages"]
        return {name: {k: v for k, v in stage.items() if k not in ("at", "seconds")} for name, stage in stages.items()}
    if path.name == "fleet.json":
        content = json.loads(path.read_bytes())
        for member in content["members"].values():
            member.pop("seconds")
        return content
    if path.suffix == ".html" and (path.parent / "fleet.json").is_file():
        return None  # the page of a fleet shows the seconds
    return path.read_bytes()


def measured(case: Case, place: Path, cache: Path, moments: int, seed: int) -> Tally:
    """One command, stopped so many times."""
    undisturbed = copied(case, place / f"{case.name} undisturbed")
    tally = Tally(through(case.words(undisturbed), cache))
    expected = contents(undisturbed)
    rng = np.random.default_rng([seed, *case.name.encode()])
    print(f"{case.name}: {tally.seconds:.1f} s undisturbed", flush=True)
    for k in range(moments):
        how, part, share = SIGNALS[k % 2], PARTS[k % 3], float(rng.uniform())
        moment = f"{case.name} {k}, {how.name} {part} {share:.3f}"
        run = copied(case, place / f"{case.name} {k}")
        if stopped(begun(case.words(run), cache), run, part, share, tally.seconds, how):
            tally.stopped[how.name] += 1
        else:
            tally.ended_before += 1
        print(f"  {moment}", flush=True)
        look(case, run, undisturbed, tally, moment)
        try:
            through(case.words(run), cache)
        except Failed as error:
            tally.note("differs", f"{moment}: {error}")
            continue
        compare(contents(run), expected, tally, moment)
        shutil.rmtree(run)
    return tally


def compare(found: dict[str, Any], expected: dict[str, Any], tally: Tally, moment: str) -> None:
    """What the second start left, against what an undisturbed one leaves."""
    litter = {name for name in found if any(part.startswith(".") for part in Path(name).parts)}
    for name in sorted(litter):
        tally.note("left behind", f"{moment}: {name}")
    for name in sorted((found.keys() | expected.keys()) - litter):
        if found.get(name, b"") != expected.get(name, b""):
            tally.note("differs", f"{moment}: {name}")


def table(tallies: dict[str, Tally]) -> str:
    kinds = list(next(iter(tallies.values())).faults)
    head = ["command", "s undisturbed", *(each.name for each in SIGNALS), "ended before", *kinds]
    rows = [[f"`{name}`", f"{t.seconds:.1f}", *map(str, t.stopped.values()), str(t.ended_before),
             *(str(len(t.faults[kind])) for kind in kinds)] for name, t in tallies.items()]  # fmt: skip
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = [*(name for name in STAGE_FILES if name in ("fit", "diagnose", "design")), "fleet"]
    parser.add_argument("--moments", type=int, default=20, help="of each command")
    parser.add_argument("--commands", nargs="+", choices=commands, default=commands)
    parser.add_argument("--seed", type=int, default=36)
    parser.add_argument("--keep", type=Path, help="a folder for all of it, where what is prepared is found again")
    asked = parser.parse_args()
    tallies: dict[str, Tally] = {}
    with tempfile.TemporaryDirectory() as scratch:
        place = asked.keep or Path(scratch)
        place.mkdir(parents=True, exist_ok=True)
        for case in cases(place, place / "cache", asked.commands):
            tallies[case.name] = measured(case, place, place / "cache", asked.moments, asked.seed)
    print(table(tallies))
    raise SystemExit(1 if any(found for t in tallies.values() for found in t.faults.values()) else 0)


if __name__ == "__main__":
    main()
