"""What the engine does with a fit that costs nothing, or that fails in a known way."""

from __future__ import annotations

import errno
import os
import time
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from etcfit.fleets.unit import AbstractWork, FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult

SYMBOLS = ("R_a", "L_a", "K_b", "K_s", "T_PL", "T_f", "J_eq", "B_eq")
TRACES = ("static_load/ramp_1.csv", "static_load/ramp_2.csv", "response/drive_1.csv", "response/drive_2.csv",
          "inertia/release_1.csv")  # fmt: skip


def result(unit: str, seconds: float) -> UnitResult:
    """As large as a fit's, and with numbers of its own, which a file cannot pack into nothing."""
    rng = np.random.default_rng(crc32(unit.encode()))
    values, spread = rng.normal(1.0, 0.03, len(SYMBOLS)), rng.normal(size=(len(SYMBOLS), len(SYMBOLS)))
    own = UnitEstimate(unit, SYMBOLS, values, spread @ spread.T)
    parameters = {symbol: UnitParameter(value, "ohm", 0.1 * value, 0.8 * value, 1.2 * value, "estimated")
                  for symbol, value in zip(SYMBOLS, values.tolist(), strict=True)}  # fmt: skip
    traces = tuple(TraceMisfit(file, file.partition("/")[0], float(rng.normal(1.0, 0.05))) for file in TRACES)
    return UnitResult(own, parameters, traces, float(rng.normal(1.0, 0.05)), True, "a stub", True, "", seconds)


@dataclass(frozen=True)
class NoFit(AbstractWork):
    """A result at once."""

    def prepare(self) -> None:
        """Nothing."""

    def digest(self, unit: str) -> str:
        return f"stub:{unit}"

    def fit(self, unit: str) -> UnitResult | FailedUnit:
        return result(unit, 0.0)


@dataclass(frozen=True)
class FullDisk(AbstractWork):
    """The disk of the first worker that asks has no room from its third unit on; each fit leaves a line in a file.

    Args:
        folder: of the lines, and of the mark that says which worker it is.
        seconds: that a unit takes.
    """

    folder: Path
    seconds: float = 0.05

    def prepare(self) -> None:
        """Be the one, where nobody is yet."""
        try:
            with (self.folder / "full").open("x") as mark:
                mark.write(str(os.getpid()))
        except FileExistsError:
            return

    def digest(self, unit: str) -> str:
        return f"stub:{unit}"

    def fit(self, unit: str) -> UnitResult | FailedUnit:
        if (self.folder / "full").read_text() == str(os.getpid()) and len(list(self.folder.glob("done-*"))) > 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), f"{self.folder}/scratch")
        time.sleep(self.seconds)
        with (self.folder / f"done-{unit}").open("a") as file:
            file.write("x")
        return result(unit, self.seconds)

    def counted(self) -> dict[str, int]:
        """How often each unit came to its end."""
        return {file.name.removeprefix("done-"): file.stat().st_size for file in self.folder.glob("done-*")}
