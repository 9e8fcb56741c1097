"""How long etcfit takes to start: imports and `etcfit --help` in fresh processes, over `import jax` and a bare Python.

    python -m benchmarks.bench_start [--repeats 9]

Every repeat starts each of them once, so that all meet the same machine; the table holds medians. `cpu` (user + system)
does not count what else the machine did meanwhile, `wall` does. A process that ran before has left its files in memory
and its byte code on disk: one round is not counted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass

STARTS = {
    "bare Python": ("-c", "pass"),
    "import jax": ("-c", "import jax"),
    "import etcfit": ("-c", "import etcfit"),
    "import etcfit.estimation.joint_fit, what a fit needs": ("-c", "import etcfit.estimation.joint_fit"),
    "etcfit --help": ("-m", "etcfit.cli", "--help"),
}
AIMS = {"import etcfit": "1.5 s", "etcfit --help": "0.5 s"}


@dataclass(frozen=True)
class Start:
    """Seconds of one process, on the wall and of the processor."""

    wall: float
    cpu: float


def start(arguments: tuple[str, ...]) -> Start:
    """A fresh Python; it must succeed."""
    began = time.perf_counter()
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)  # of this process alone, unlike RUSAGE_CHILDREN
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return Start(wall, usage.ru_utime + usage.ru_stime)


def measured(repeats: int) -> dict[str, Start]:
    """Medians by name."""
    rounds = [{name: start(arguments) for name, arguments in STARTS.items()} for _ in range(repeats + 1)][1:]
    return {
        name: Start(statistics.median(r[name].wall for r in rounds), statistics.median(r[name].cpu for r in rounds))
        for name in STARTS
    }


def table(starts: dict[str, Start]) -> str:
    """A line a start; ratios are those of the processor's time."""
    bare, jax = starts["bare Python"].cpu, starts["import jax"].cpu
    lines = ["| | wall s | cpu s | x bare Python | x import jax | aim |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {name} | {s.wall:.3f} | {s.cpu:.3f} | {s.cpu / bare:.1f} | {s.cpu / jax:.2f} | {AIMS.get(name, '')} |"
        for name, s in starts.items()
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    load = os.getloadavg()[0]
    print(f"{table(measured(repeats))}\n\nmedians of {repeats}; load {load:.1f} before, on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
