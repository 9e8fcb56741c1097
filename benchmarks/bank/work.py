"""Folders run in processes of one core each, each record kept at once; what is there already is not run again."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from ..processes import fresh
from .cases import Case
from .judging import Record, grade, said, title
from .records import blank, one

ROOT = Path(__file__).resolve().parents[2]
_MADE_OF = ("etcfit", "independent", "benchmarks/bank")  # what a record depends on
_A_PROCESS = 12  # folders that one does before another takes its place
ONE_CORE = {"ETCFIT_CORES": "1", "PJRT_NPROC": "1"}
Key = tuple[str, int, str]


def commit() -> str:
    """The commit checked out; with a digest of what was changed since and not committed, where something was."""
    short = _git("rev-parse", "--short=9", "HEAD").strip()
    changed = _git("diff", "HEAD", "--", *_MADE_OF) + _git("status", "--porcelain", "--", *_MADE_OF)
    return f"{short}+{hashlib.sha1(changed.encode()).hexdigest()[:6]}" if changed.strip() else short


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def key(record: Record) -> Key:
    """As `Case.key`."""
    return record["class"], record["seed"], "+".join(record["truth"]["names"])


def saved(file: Path) -> list[Record]:
    """Every record of a file; a last line that was cut off while it was written is none."""
    if not file.exists():
        return []
    *whole, last = file.read_text(encoding="utf-8").split("\n")
    try:
        return [json.loads(line) for line in (*whole, *([last] if last.strip() else []))]
    except json.JSONDecodeError:
        return [json.loads(line) for line in whole]


def latest(records: Sequence[Record]) -> dict[Key, Record]:
    """The last record of each folder."""
    return {key(record): record for record in records}


def append(file: Path, record: Record) -> None:
    """One line more; one that was cut off before gives way to it."""
    text = file.read_bytes() if file.exists() else b""
    if text and not text.endswith(b"\n"):
        os.truncate(file, text.rfind(b"\n") + 1)
    with file.open("a", encoding="utf-8") as out:
        out.write(json.dumps(record) + "\n")


def run(
    cases: Sequence[Case],
    jobs: int,
    file: Path,
    report: Callable[[str], None],
    made: Callable[[Sequence[Case], int], Iterable[Record]] | None = None,
    version: str | None = None,
) -> list[Record]:
    """The folders' records, those of an earlier run of this commit among them.

    Args:
        cases: wanted.
        jobs: processes.
        file: to which each record is appended; those of other commits stay in it.
        report: is given a line a folder, with the time that the rest will take.
        made: makes the records of cases in so many processes.
        version: which commit makes them.
    """
    version = version or commit()
    there = latest([r for r in saved(file) if r["commit"] == version])
    left = [case for case in cases if case.key not in there]
    began = time.monotonic()
    for n, record in enumerate((made or in_processes)(left, jobs), 1):
        record |= {"commit": version}
        append(file, record)
        there[key(record)] = record
        rest = (time.monotonic() - began) / n * (len(left) - n)
        report(f"{n} of {len(left)}, {clock(rest)} left; {title(record)}: {grade(record)}; {said(record)}; "
               f"{record['seconds']:.0f} s")  # fmt: skip
    return [there[case.key] for case in cases if case.key in there]


def in_processes(cases: Sequence[Case], jobs: int, work: Callable[[Case], Record] = one) -> Iterator[Record]:
    """Records as they are ready. A process that dies takes its siblings with it: those that it may have been at are run
    one by one."""
    os.environ |= ONE_CORE
    left = list(cases)
    while left:
        try:
            for case, record in fresh(work, tuple(left), jobs, _A_PROCESS):
                left.remove(case)
                yield record
        except BrokenProcessPool:
            suspects, left = left[: jobs + 1], left[jobs + 1 :]
            yield from (_alone(case, work) for case in suspects)


def _alone(case: Case, work: Callable[[Case], Record]) -> Record:
    try:
        ((_, record),) = fresh(work, (case,), 1, 1)
    except BrokenProcessPool:
        return blank(case, {}) | {"error": "its process died"}
    return record


def clock(seconds: float) -> str:
    """1 h 05 min, 12 min, 40 s."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min" if minutes else f"{rest} s"
