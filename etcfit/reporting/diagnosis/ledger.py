"""THE LEDGER: free-running errors before and after, by test and channel, and their summary in one sentence.

Angles are shown in degrees for any sensor, other quantities in the logged unit or with a prefix.
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
from ..tables import Entry, entries
from ..traces import source

DEGREES = 180.0 / np.pi
# axis: its name, its unit in output, and the number of these units in one of SI
QUANTITIES = {"angle": ("plate angle", "deg", DEGREES), "speed": ("plate speed", "rad/s", 1.0),
              "current": ("current", "A", 1.0), "load": ("torque through the gear", "N m", 1.0),
              "time": ("time", "s", 1.0)}  # fmt: skip
_SMALL = 0.2  # value below which a thousandth is the better unit
_THOUSANDTHS = ("N m", "V", "A")


def prefixed(limit: float, unit: str) -> tuple[float, str]:
    """Factor and unit for values up to `limit`, given in SI."""
    unit = unit.replace("*", " ")
    if unit == "rad":
        return DEGREES, "deg"
    return (1e3, f"m{unit}") if limit < _SMALL and unit in _THOUSANDTHS else (1.0, unit or "1")


@dataclass(frozen=True, eq=False)
class Shown:
    """The form of one channel of a trace in output."""

    unit: str  # unit of the shown values
    size: float  # that unit in SI
    origin: float = 0.0  # value shown as zero, SI

    @classmethod
    def of_channel(cls, trace: Trace, name: str) -> Shown:
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


_LESS = 0.95  # ratio below which an error counts as smaller


def ledger(diagnosis: Diagnosis) -> tuple[Entry, ...]:
    """Held-out traces first, then the fitted ones, each in the order of the data; positions in degrees, others in the
    logged unit."""
    before, after, unknown = diagnosis.before, diagnosis.after, diagnosis.unexplained
    degrees = scales(before)
    fitted = after.score_fit, before.score_fit, unknown.fit if unknown else ()
    held_out = after.score_holdout, before.score_holdout, unknown.holdout if unknown else ()
    (now, was, then), others = ([in_degrees(rows, degrees) for rows in part] for part in (fitted, held_out))
    return entries(now, others[0], (was, others[1]), (then, others[2]))


def headline(diagnosis: Diagnosis) -> str:
    """The ledger in one sentence: the largest error on held-out traces, before and after."""
    known = [entry for entry in ledger(diagnosis) if entry.known()]
    if not known:
        return "The model cannot be simulated"
    worst = max(known, key=lambda entry: (entry.held_out, entry.before.ratio))
    where = f"{'held-out ' if worst.held_out else ''}{worst.channel.replace('_', ' ')} error ({worst.test})"
    was, now = (f"{short(pool.rms)} {worst.unit or '1'}" for pool in (worst.before, worst.after))
    sigma = short(worst.before.ratio, 2), short(worst.after.ratio, 2)
    if not diagnosis.added:
        white = all(each.evidence.white for each in diagnosis.rounds)
        said = "The start model explains the data" if white else "No effect of the catalogue explains what is missing"
        return f"{said}: largest {where} {now}, {sigma[1]} σ"
    falls = "falls" if worst.after.ratio < _LESS * worst.before.ratio else "does not fall"
    return f"With {listed(diagnosis.added)} the {where} {falls}: {was} → {now}, {sigma[0]} → {sigma[1]} σ"
