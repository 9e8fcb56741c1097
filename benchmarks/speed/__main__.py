"""The command line, see the package."""

from __future__ import annotations

import argparse
import os
import platform
import signal
import sys
import tempfile
import traceback
from collections.abc import Iterator
from datetime import date
from importlib.metadata import version as installed
from pathlib import Path

from ..runs import ROOT, Failed, Skipped
from . import __doc__ as usage
from .rows import ROWS, Row
from .table import PLACE, Outcome, table, text
from .versions import Version

Measured = tuple[str, Row, Outcome, Outcome]


def named(names: str) -> list[str]:
    """Rows by name, those of every run if there is none."""
    chosen = names.split(",") if names else [name for name, row in ROWS.items() if not row.on_demand]
    if unknown := [name for name in chosen if name not in ROWS]:
        raise argparse.ArgumentTypeError(f"no row {', '.join(unknown)}; there are {', '.join(ROWS)}")
    return chosen


def measured(name: str, versions: tuple[Version, Version], repeats: int) -> Measured:
    """Each version in turn, as often; one that failed is not tried again."""
    outcomes = Outcome(), Outcome()
    for k in range(repeats):
        for version, outcome in zip(versions, outcomes, strict=True):
            if not outcome.failure:
                measure(name, version, outcome)
                say(f"{name} {k + 1}, {version.name}", outcome)
    return name, ROWS[name], *outcomes


def measure(name: str, version: Version, outcome: Outcome) -> None:
    """Once more, or why not: whatever it is, other rows are measured all the same."""
    try:
        outcome.repeats.append(ROWS[name].measure(version))
    except Skipped as skipped:
        outcome.failure = f"skipped: {skipped}"
    except Exception as error:
        traceback.print_exc()
        why = str(error) if isinstance(error, Failed) else repr(error)
        outcome.failure = f"**failed** in repeat {len(outcome.repeats) + 1}: {why}"


def say(what: str, outcome: Outcome) -> None:
    """The last repeat, on stderr."""
    found = {"": outcome.failure} if outcome.failure else {k: text(v) for k, v in outcome.repeats[-1].items()}
    words = "; ".join(f"{line}: {each}" if line else each for line, each in found.items())
    print(f"{what}: {words}; load {os.getloadavg()[0]:.1f}", file=sys.stderr, flush=True)


def heading(versions: tuple[Version, Version], repeats: int) -> str:
    """The machine as it is before anything is measured, the versions, and how the figures came about."""
    machine = f"{os.cpu_count()} cores ({_processor()}), {_memory():.0f} GiB, load {os.getloadavg()[0]:.1f} before"
    software = f"Python {platform.python_version()}, jax {installed('jax')}, numpy {installed('numpy')}"
    how = f"Medians of {repeats}, old and new in turns; wall time where nothing is said."
    return f"{date.today()}; {'; '.join(map(str, versions))}. {machine}; {software}. {how}"


def _processor() -> str:
    """Its name, as the system has it."""
    lines = _lines_of(Path("/proc/cpuinfo"))
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _memory() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30


def _lines_of(path: Path) -> Iterator[str]:
    return iter(path.read_text().splitlines() if path.exists() else ())


def arguments() -> argparse.Namespace:
    """What is wanted."""
    parser = argparse.ArgumentParser(description=usage, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=named, default="", metavar="NAME,NAME", help=", ".join(ROWS))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--old", default="3cff18f", metavar="REF", help="a commit, or a folder with a tree")
    parser.add_argument("--new", default=str(ROOT), metavar="REF", help="the same; this tree if not given")
    parser.add_argument("--limit", type=float, default=1200.0, help="s that a process may take")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table there too, between its markers")
    return parser.parse_args()


def main() -> None:
    """Measure row by row; the file holds what is known so far, should it not come to its end."""
    choices = arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended"))  # as an interrupt: no process is left behind
    if choices.markdown:
        PLACE.must_be_in(choices.markdown)
    with tempfile.TemporaryDirectory(prefix="etcfit-speed-") as name:
        old, new = (Version.of(each, getattr(choices, each), Path(name), choices.limit) for each in ("old", "new"))
        head, rows = heading((old, new), choices.repeats), []
        print(head, file=sys.stderr, flush=True)
        for row in choices.rows:
            rows.append(measured(row, (old, new), choices.repeats))
            if choices.markdown:
                PLACE.put(choices.markdown, f"{head}\n\n{table(rows)}")
    print(f"{head}\n\n{table(rows)}")


if __name__ == "__main__":
    main()
