"""What each mechanism of a diagnosis is worth: the folders in which it acted, once more without it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .cases import Case
from .judging import Record, hold
from .mechanisms import MECHANISMS, WITHOUT
from .table import markdown, share, worsened
from .work import Key, commit, key, run, saved

_SAYS = " without "  # between the commit and the mechanism that was switched off


def run_without(
    names: Sequence[str],
    cases: Sequence[Case],
    base: Mapping[Key, Record],
    jobs: int,
    file: Path,
    report: Callable[[str], None],
) -> None:
    """Runs, for each mechanism, the cases in which it acted without it.

    Args:
        names: mechanisms, see `MECHANISMS`.
        cases: those of them that `base` does not hold are left out.
        base: records with all mechanisms at work.
        jobs, file, report: as of `work.run`.
    """
    version = commit()
    for name in names:
        acted = [case for case in cases if name in base.get(case.key, {}).get("acted", ())]
        os.environ[WITHOUT] = name
        report(f"without {name}: {len(acted)} folders")
        run(acted, jobs, file, report, version=f"{version}{_SAYS}{name}")
    del os.environ[WITHOUT]


def ablation(file: Path, base: Mapping[Key, Record]) -> str:
    """A row for each mechanism of a file of `run_without`.

    Names and intervals are those of the folders in which it acted; "worse" and "better" are as in the table of changes.
    """
    rows = []
    for name, mechanism in MECHANISMS.items():
        acted = sum(name in record.get("acted", ()) for record in base.values())
        new = [r for r in saved(file) if r["commit"].endswith(f"{_SAYS}{name}") and key(r) in base]
        if acted and not new:  # not run
            continue
        old = [base[key(record)] for record in new]
        pairs = [*zip(old, new, strict=True)]
        worse = [_place(r) for was, r in pairs if worsened(was, r)]
        better = [_place(r) for was, r in pairs if worsened(r, was) and not worsened(was, r)]
        seconds = " → ".join(f"{sum(r['seconds'] for r in some):.0f}" for some in (old, new))
        holding = [share(hold(some)) for some in (old, new)]
        rows.append(
            [name, mechanism.does, f"{len(new)} of {acted}", _listed(worse), _listed(better), *holding, seconds]
        )
    head = ["mechanism", "what it does", "run without it, of those in which it acted", "worse without it",
            "better without it", "intervals hold with it", "without it", "s cpu, with → without"]  # fmt: skip
    return markdown(head, rows)


def _place(record: Record) -> str:
    return f"{record['class']} {record['seed']}"


def _listed(places: Sequence[str]) -> str:
    return f"{len(places)}: {', '.join(places)}" if places else "0"
