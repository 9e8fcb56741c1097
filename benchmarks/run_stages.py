"""Where `etcfit run` spends its processor time: the command itself in this process, a line on stderr as a stage ends.

    ETCFIT_CACHE=EMPTY python -m benchmarks.run_stages FOLDER --out RUN --quiet

Seconds of user and system time of this process, of the one that draws pictures beside it, and of the clock, which says
little on a machine that others use. Linux alone tells the helper's.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from typing import Any

from etcfit import cli, stages


def helpers() -> float:
    """Processor time of the processes that this one began and that still run, s."""
    total = 0.0
    for child in active_children():
        status = Path(f"/proc/{child.pid}/stat")
        if status.exists():
            user, system = status.read_text().rsplit(")", 1)[1].split()[11:13]
            total += (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
    return total


def timed(stage: stages.Stage) -> stages.Stage:
    """The stage, which says what it took."""

    def work(*args: Any, **options: Any) -> stages.Done:
        wall, own, beside = time.perf_counter(), time.process_time(), helpers()
        try:
            return stage.work(*args, **options)
        finally:
            own, beside = time.process_time() - own, helpers() - beside
            wall = time.perf_counter() - wall
            print(
                f"{stage.name:10s} {own:7.2f} s  helper {beside:6.2f} s  wall {wall:6.2f} s",
                file=sys.stderr,
                flush=True,
            )

    return replace(stage, work=work)


def main() -> None:
    stages.stages_until = partial(stages.stages_until, stages=tuple(map(timed, stages.STAGES)))
    sys.argv = ["etcfit", "run", *sys.argv[1:]]
    try:
        cli.main()
    finally:
        print(f"{'all':10s} {time.process_time():7.2f} s  helper {helpers():6.2f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
