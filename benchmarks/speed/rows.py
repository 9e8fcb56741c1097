"""The rows: what is measured of a version, and what it should be. A row is a function and a line of `ROWS`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..runs import DATA, ROOT, Run, Skipped, busy
from .versions import CONVERGED_OR_NOT, Version, core

TWIN = ROOT / "measurements" / "bench_twin"
STEPS = 200  # of a chain whose pace is measured

Figures = Mapping[str, float]  # by unit; the first is what versions are compared by
Lines = dict[str, Figures]  # what a row measures, by what distinguishes its lines: "cold", "warm"


@dataclass(frozen=True)
class Aim:
    """At most so much of that unit, or at least."""

    value: float
    unit: str
    at_least: bool = False

    def __str__(self) -> str:
        return f"{'at least ' * self.at_least}{self.value:g} {self.unit}"

    def met(self, figures: Figures) -> bool:
        """Whether it was."""
        found = figures[self.unit]
        return found >= self.value if self.at_least else found <= self.value


@dataclass(frozen=True)
class Row:
    """A row.

    Args:
        measure: its figures, measured once; what its docstring says stands in the table.
        aims: by line.
        on_demand: measured only where it is named.
    """

    measure: Callable[[Version], Lines]
    aims: Mapping[str, tuple[Aim, ...]]
    on_demand: bool = False

    @property
    def what(self) -> str:
        """What is measured, in a few words."""
        return " ".join((self.measure.__doc__ or "").split()).rstrip(".")


def figures(run: Run) -> Figures:
    """Those of a process."""
    return {"s": run.wall, "s cpu": run.cpu, "MiB": run.peak}


def runs(
    version: Version,
    command: Callable[[Path], Iterable[Any]],
    names: Iterable[str] = ("cold", "warm"),
    fitted: Path | None = None,
) -> dict[str, Run]:
    """A command in an empty cache, then the same again in that cache.

    Args:
        version: whose command it is.
        command: the arguments of etcfit for a run folder.
        names: of the runs, one after the other.
        fitted: the run folder a copy of which each of them goes on from; without it, none is there.
    """
    out = {}
    with version.room() as room:
        for name in names:
            if fitted is not None:
                shutil.copytree(fitted, room / name)
            out[name] = version.etcfit(*command(room / name), cache=room / "cache")
    return out


def lines(found: Mapping[str, Run]) -> Lines:
    """A line a run."""
    return {name: figures(run) for name, run in found.items()}


def fit_of(folder: Path) -> Callable[[Path], Iterable[Any]]:
    """The arguments of a fit, by run folder."""
    return lambda run: ("fit", folder, "--out", run, "--quiet")


def diagnosis_of(run: Path) -> Iterable[Any]:
    """The arguments of a diagnosis."""
    return "diagnose", run, "--quiet"


def diagnosed(version: Version, folder: Path, *names: str) -> Lines:
    """A line a diagnosis of this version's own fit."""
    return lines(runs(version, diagnosis_of, names, version.fitted(folder)))


def check(version: Version) -> Lines:
    """`etcfit check` of the bench twin."""
    return lines(runs(version, lambda _: ("check", TWIN, "--quiet")))


def main(version: Version) -> Lines:
    """README's main command, `etcfit fit` of the bench twin, beside a process that keeps a core busy."""
    with busy():
        return lines(runs(version, fit_of(TWIN)))


def fit30(version: Version) -> Lines:
    """`etcfit fit`, 30 traces, 68,000 samples."""
    return lines(runs(version, fit_of(version.folder("fit30"))))


def diagnose(version: Version) -> Lines:
    """`etcfit diagnose` of the bench twin's fit."""
    return diagnosed(version, TWIN, "cold", "warm")


def run(version: Version) -> Lines:
    """`etcfit run` of the bench twin."""
    return lines(runs(version, lambda run: ("run", TWIN, "--out", run, "--quiet"), ("cold",)))


def jacobian(version: Version) -> Lines:
    """A linearisation of the 30 traces over their chi2 at one point of 64."""
    return {"": version.inside("jacobian", version.fitted(version.folder("fit30")))}


def logprob(version: Version) -> Lines:
    """A log-probability of the 30 traces, as the sampler asks for it."""
    return {"": version.inside("logprob", version.fitted(version.folder("fit30")))}


def step(version: Version) -> Lines:
    """A step of the simulation."""
    found = version.inside("step")
    return {"one trace": {"ns": found["one"]}, "a lane of 256": {"ns": found["lane"]}}


def cores(version: Version) -> Lines:
    """Time on one core over that on all, bench twin, warm."""
    one, fitted = core(), version.fitted(TWIN)
    commands = {
        "fit": (fit_of(TWIN), None),
        "diagnose": (diagnosis_of, fitted),
        "sample": (lambda run: ("sample", run, "--steps", STEPS, "--quiet"), fitted),
    }
    return {name: _gain(version, name, one, *how) for name, how in commands.items()}


def _gain(
    version: Version, name: str, one: int, command: Callable[[Path], Iterable[Any]], fitted: Path | None
) -> Figures:
    """Wall time on one core over that on all; what is compiled may differ, so that each has a cache of its own."""

    def work(cache: Path, where: int | None) -> Run:
        with version.room() as room:
            if fitted is not None:
                shutil.copytree(fitted, room / "run")
            return version.etcfit(*command(room / "run"), cache=cache, core=where, accepted=CONVERGED_OR_NOT)

    def warm(where: int | None) -> float:
        cache = version.warmed(f"{name} on {'all' if where is None else where}", lambda path: work(path, where))
        return work(cache, where).wall

    alone, together = warm(one), warm(None)
    return {"x": alone / together, "s on one": alone, "s on all": together}


def public(version: Version, name: str) -> Lines:
    """The diagnosis of a public data set."""
    if not os.environ.get(DATA):
        raise Skipped(f"{DATA} names no folder of local copies")
    return diagnosed(version, version.folder(name), "cold")


def kassel(version: Version) -> Lines:
    """`etcfit diagnose` of the Kassel throttle."""
    return public(version, "kassel-throttle")


def bam(version: Version) -> Lines:
    """`etcfit diagnose` of the BAM servo."""
    return public(version, "bam-xl330")


def missing(version: Version) -> Lines:
    """`etcfit diagnose`, 26 traces, 37,000 samples, an effect missing."""
    return diagnosed(version, version.folder("missing"), "cold")


def two(version: Version) -> Lines:
    """`etcfit diagnose`, 30 traces, 50,000 samples, two effects missing."""
    return diagnosed(version, version.folder("two"), "cold")


def long20(version: Version) -> Lines:
    """`etcfit fit`, 41 traces, 420,000 samples."""
    return lines(runs(version, fit_of(version.folder("long20"))))


def memory200(version: Version) -> Lines:
    """`etcfit fit`, 200 traces of 20,000 samples."""
    return lines(runs(version, fit_of(version.folder("memory200")), ("cold",)))


def scipy(version: Version) -> Lines:
    """SciPy's CPU time over that of `etcfit fit`, 30 traces, scaled to as many Jacobians."""
    folder = version.folder("fit30")
    with version.room() as room:
        told = version.python("-m", "benchmarks.stages", folder, room / "run")
        (room / "stages.json").write_text(told.stdout.splitlines()[-1], encoding="utf-8")
        by_scipy = version.inside("scipy", folder, room / "run", room / "stages.json")
    took = runs(version, fit_of(folder))
    return {
        f"{name}, {words}": {"x": by_scipy["jacobian"] * by_scipy[which] / run.cpu, "Jacobians": by_scipy[which]}
        for which, words in (("all", "all Jacobians"), ("lean", "from the reading and rounds alone"))
        for name, run in took.items()
    }


STARTS = {
    "bare Python": ("-c", "pass"),
    "import jax": ("-c", "import jax"),
    "import etcfit": ("-c", "import etcfit"),
    "import etcfit.fit, all that a fit needs": ("-c", "import etcfit.estimation.joint_fit; from etcfit import fit"),
    "etcfit --version": ("-m", "etcfit.cli", "--version"),
    "etcfit --help": ("-m", "etcfit.cli", "--help"),
}


def start(version: Version) -> Lines:
    """Fresh processes that do next to nothing."""
    for arguments in STARTS.values():  # one round is not counted: files get into memory
        version.python(*arguments)
    return {name: figures(version.python(*arguments)) for name, arguments in STARTS.items()}


def _most(unit: str, **values: float) -> dict[str, tuple[Aim, ...]]:
    return {name: (Aim(value, unit),) for name, value in values.items()}


def _least(unit: str, values: Mapping[str, float]) -> dict[str, tuple[Aim, ...]]:
    return {name: (Aim(value, unit, at_least=True),) for name, value in values.items()}


_GIB, _GB = 1024.0, 1e9 / 2**20  # MiB

ROWS: dict[str, Row] = {
    "check": Row(check, _most("s", cold=5.0, warm=1.5)),
    "main": Row(main, _most("s", cold=8.0, warm=4.0)),
    "fit30": Row(
        fit30,
        {name: (Aim(most, "s"), Aim(round(0.6 * _GIB), "MiB")) for name, most in (("cold", 7.0), ("warm", 3.0))},
    ),
    "diagnose": Row(diagnose, _most("s", cold=20.0, warm=8.0)),
    "run": Row(run, _most("s", cold=90.0)),
    "jacobian": Row(jacobian, {"": (Aim(15.0, "x"),)}),
    "logprob": Row(logprob, {"": (Aim(0.2, "ms"),)}),
    "step": Row(step, {"one trace": (Aim(25.0, "ns"),), "a lane of 256": (Aim(5.0, "ns"),)}),
    "cores": Row(cores, _least("x", {"fit": 1.7, "diagnose": 1.7, "sample": 1.7})),
    "kassel": Row(kassel, {"cold": (Aim(40.0, "s"), Aim(round(_GB), "MiB"))}),
    "bam": Row(bam, _most("s", cold=60.0)),
    "missing": Row(missing, _most("s", cold=120.0)),
    "two": Row(two, {"cold": (Aim(60.0, "s"), Aim(round(_GB), "MiB"))}, on_demand=True),
    "long20": Row(long20, {"warm": (Aim(20.0, "s"), Aim(round(0.8 * _GB), "MiB"))}, on_demand=True),
    "memory200": Row(memory200, {"cold": (Aim(150.0, "s"), Aim(round(2.0 * _GIB), "MiB"))}, on_demand=True),
    "scipy": Row(scipy, _least("x", {"cold, all Jacobians": 100.0, "warm, all Jacobians": 250.0})),
    "start": Row(start, {"import etcfit": (Aim(1.5, "s"),), "etcfit --help": (Aim(0.5, "s"),)}),
}
