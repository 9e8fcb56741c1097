"""Stub work for the engine of a fleet: each counts its calls in files, so that a test sees what was done how often."""

from __future__ import annotations

import errno
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from etcfit.errors import MeasurementError
from etcfit.fleets.unit import AbstractWork, FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult


def result_of(unit: str, symbols: tuple[str, ...] = ("R_a", "K_b"), seed: int | None = None) -> UnitResult:
    """A result in which every number differs."""
    rng = np.random.default_rng(sum(map(ord, unit)) if seed is None else seed)
    spread = rng.normal(size=(len(symbols), len(symbols)))
    parameters = {s: UnitParameter(float(v), "ohm", abs(float(v)), None, float("nan"), "estimated")
                  for s, v in zip(symbols, rng.normal(size=len(symbols)), strict=True)}  # fmt: skip
    return UnitResult(
        UnitEstimate(unit, symbols, rng.normal(size=len(symbols)), spread @ spread.T),
        {**parameters, "N": UnitParameter(20.68, "1", None, None, None, "fixed")},
        (TraceMisfit("response/1.csv", "response", float(rng.uniform())),),
        float(rng.uniform()),
        True,
        "the fit converged",
        True,
        "",
        float(rng.uniform()),
        ("a warning, with an ö",),
        {symbol: 1.0 + float(rng.uniform()) for symbol in symbols},
    )


# what a unit does to whoever works on it
Habit = Callable[[], object]


def nothing() -> None:
    """Gives its result at once."""


def sleeps(seconds: float) -> Habit:
    return partial(time.sleep, seconds)


def loops() -> None:
    while True:
        time.sleep(0.01)


def kills() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def kills_once(mark: Path) -> Habit:
    return partial(_kill_once, mark)


def _kill_once(mark: Path) -> None:
    if not mark.exists():
        mark.touch()
        kills()


def divides() -> None:
    raise ZeroDivisionError("division by zero")


def broken() -> None:
    raise MeasurementError("response/3.csv:118", "time falls.", "It must rise.", "Sort it.")


def eats() -> None:
    """Takes memory, until somebody ends it."""
    held = []
    while True:
        held.append(np.ones(2_000_000))
        time.sleep(0.01)


def always_full() -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def full_disk(mark: Path) -> Habit:
    """No room on the machine of the first worker that meets it; `mark` says which process that is."""
    return partial(_full_where_marked, mark)


def _full_where_marked(mark: Path) -> None:
    if not mark.exists():
        mark.write_text(str(os.getpid()))
    if mark.read_text() == str(os.getpid()):
        always_full()


@dataclass(frozen=True)
class CountingWork(AbstractWork):
    """Appends a line to `counts/<unit>` when it begins a unit, then does what that unit is said to do."""

    counts: Path  # folder
    habits: Mapping[str, Habit] = field(default_factory=dict)  # by unit; the others give their result at once
    usual: Habit = nothing  # habit of the others
    edition: Mapping[str, str] = field(default_factory=dict)  # goes into the digest

    def prepare(self) -> None:
        with (self.counts / f".prepared-{os.getpid()}").open("a") as file:
            file.write("x")

    def digest(self, unit: str) -> str:
        return f"{unit}:{self.edition.get(unit, '1')}"

    def fit(self, unit: str) -> UnitResult | FailedUnit:
        with (self.counts / unit).open("a") as file:
            file.write("x")
        self.habits.get(unit, self.usual)()
        return result_of(unit)

    def counted(self) -> dict[str, int]:
        """How often each unit was begun."""
        return {file.name: len(file.read_text()) for file in self.counts.iterdir() if not file.name.startswith(".")}


def cores_here() -> int:
    from etcfit.problem.cores import CORES

    return CORES
