"""THE LEDGER: free-running errors before and after, by test and channel, and what they come to in one sentence.

Angles are shown in degrees whatever the sensor, all else as logged or with a prefix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...diagnosis.findings import Diagnosis
from ...estimation.identifiability import listed
from ...estimation.joint_fit import FitResult
from ...problem.prediction_error import PredictionError, logged_unit
from ...problem.trace import Trace
from ..numbers import short
from ..pictures import all_traces
from ..pool import Pool, grouped
from ..traces import source

DEGREES = 180.0 / np.pi
# what something may depend on: its name, the unit in which it is shown, and how many of that are one of SI
QUANTITIES = {"angle": ("plate angle", "deg", DEGREES), "speed": ("plate speed", "rad/s", 1.0),
              "current": ("current", "A", 1.0), "load": ("torque through the gear", "N m", 1.0),
              "time": ("time", "s", 1.0)}  # fmt: skip
_SMALL = 0.2  # below which a thousandth is the better unit
_THOUSANDTHS = ("N m", "V", "A")


def prefixed(limit: float, unit: str) -> tuple[float, str]:
    """Factor and unit for values up to `limit`, given in SI."""
    unit = unit.replace("*", " ")
    if unit == "rad":
        return DEGREES, "deg"
    return (1e3, f"m{unit}") if limit < _SMALL and unit in _THOUSANDTHS else (1.0, unit or "1")


@dataclass(frozen=True, eq=False)
class Shown:
    """One channel of a trace as it is shown.

    Args:
        unit: of the values shown.
        size: that unit in SI.
        origin: what is shown as zero, SI.
    """

    unit: str
    size: float
    origin: float = 0.0

    @classmethod
    def of(cls, trace: Trace, name: str) -> Shown:
        """Degrees for the position, the logged unit for anything else."""
        if name == "position":
            return cls("deg", 1.0 / DEGREES)
        logged = source(trace, name)
        return cls(logged.unit or "1", logged.scale, logged.offset)

    def __call__(self, value: np.ndarray) -> np.ndarray:
        return (value - self.origin) / self.size


def scales(result: FitResult) -> dict[str, float]:
    """Degrees in one logged unit of position, by file."""
    return {t.measurement.file: DEGREES * logged_unit(t, "position")[1]
            for t in all_traces(result) if "position" in t.channels}  # fmt: skip


def in_degrees(rows: Sequence[PredictionError], scales: Mapping[str, float]) -> tuple[PredictionError, ...]:
    """Errors of the position in degrees; the other rows as they are."""
    return tuple(
        replace(r, unit="deg", rms=r.rms * scales[r.file], sigma=r.sigma * scales[r.file])
        if r.channel == "position" and r.file in scales
        else r
        for r in rows
    )


_LESS = 0.95  # of an error that counts as smaller


@dataclass(frozen=True)
class Entry:
    """One channel of one test, all its traces pooled.

    Args:
        test, channel, unit, held_out: which; the unit as shown: positions in degrees, all else as logged.
        before, after: errors of the first and of the final model.
        unknown: of the final model with what no effect explains added as a smooth curve; None where nothing is left.
    """

    test: str
    channel: str
    unit: str
    held_out: bool
    before: Pool
    after: Pool
    unknown: Pool | None

    @property
    def name(self) -> str:
        return f"{self.test} · {self.channel.replace('_', ' ')}"

    def change(self) -> str:
        """ "2.10 → 0.340 deg"."""
        return f"{short(self.before.rms)} → {short(self.after.rms)} {self.unit or '1'}"

    def known(self) -> bool:
        """True where both models could be simulated."""
        return bool(np.isfinite(self.before.ratio) and np.isfinite(self.after.ratio))


def ledger(diagnosis: Diagnosis) -> tuple[Entry, ...]:
    """Held-out traces first, then the fitted ones, each in the order of the data."""
    before, after, unknown = diagnosis.before, diagnosis.after, diagnosis.unexplained
    degrees = scales(before)
    held_out = before.score_holdout, after.score_holdout, unknown.holdout if unknown else ()
    fitted = before.score_fit, after.score_fit, unknown.fit if unknown else ()
    return (
        *_entries(*(in_degrees(rows, degrees) for rows in held_out), held_out=True),
        *_entries(*(in_degrees(rows, degrees) for rows in fitted), held_out=False),
    )


def _entries(
    before: Sequence[PredictionError],
    after: Sequence[PredictionError],
    unknown: Sequence[PredictionError],
    held_out: bool,
) -> list[Entry]:
    shared = {row.file for row in after}  # a trace of another rig has no error afterwards
    was, now, then = grouped([row for row in before if row.file in shared]), grouped(after), grouped(unknown)
    return [Entry(*key, held_out, Pool.of(was[key]), Pool.of(now[key]), Pool.of(then[key]) if key in then else None)
            for key in was if key in now]  # fmt: skip


def headline(diagnosis: Diagnosis) -> str:
    """The ledger in one sentence: the largest error on traces that were never fitted, before and after."""
    entries = [entry for entry in ledger(diagnosis) if entry.known()]
    if not entries:
        return "The model cannot be simulated"
    worst = max(entries, key=lambda entry: (entry.held_out, entry.before.ratio))
    where = f"{'held-out ' if worst.held_out else ''}{worst.channel.replace('_', ' ')} error ({worst.test})"
    was, now = (f"{short(pool.rms)} {worst.unit or '1'}" for pool in (worst.before, worst.after))
    sigma = short(worst.before.ratio, 2), short(worst.after.ratio, 2)
    if not diagnosis.added:
        white = all(each.evidence.white for each in diagnosis.rounds)
        said = "The start model explains the data" if white else "No effect of the catalogue explains what is missing"
        return f"{said}: largest {where} {now}, {sigma[1]} σ"
    falls = "falls" if worst.after.ratio < _LESS * worst.before.ratio else "does not fall"
    return f"With {listed(diagnosis.added)} the {where} {falls}: {was} → {now}, {sigma[0]} → {sigma[1]} σ"
