"""Errors of many traces as one, and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..problem.prediction_error import PredictionError, pooled
from .numbers import short
from .table import Column, Table, role


@dataclass(frozen=True)
class Pool:
    """Root mean squares over traces, each counting for its samples.

        rms^2 = sum n_k rms_k^2 / sum n_k,    likewise sigma and ratio = rms / sigma

    Args:
        traces, samples: how many.
        rms, sigma: in the unit of the rows.
        ratio: of rms and sigma, row by row.
    """

    traces: int
    samples: int
    rms: float
    sigma: float
    ratio: float

    @classmethod
    def of_rows(cls, rows: Sequence[PredictionError]) -> Pool:
        """Rows of one unit; of several units only the ratio means anything."""
        n = np.array([row.n for row in rows], dtype=float)

        def mean(values: list[float]) -> float:
            return float(np.sqrt(np.sum(n * np.array(values) ** 2) / n.sum()))

        rms, sigma = mean([row.rms for row in rows]), mean([row.sigma for row in rows])
        return cls(len(rows), int(n.sum()), rms, sigma, pooled(rows))


def grouped(rows: Sequence[PredictionError]) -> dict[tuple[str, str, str], list[PredictionError]]:
    """Rows by test, channel and unit, in the order in which these come."""
    groups: dict[tuple[str, str, str], list[PredictionError]] = {}
    for row in rows:
        groups.setdefault((row.test, row.channel, row.unit), []).append(row)
    return groups


@dataclass(frozen=True)
class Entry:
    """One channel of one test, all its traces pooled.

    Args:
        test, channel, unit, held_out: which; the unit as shown.
        before, after: errors of the first and of the final model; of a fit alone both are its own.
        unknown: of the final model with what no effect explains added as a smooth curve; None where nothing is left.
        explained: share of the motion, 0 to 1; None where it is not known.
    """

    test: str
    channel: str
    unit: str
    held_out: bool
    before: Pool
    after: Pool
    unknown: Pool | None = None
    explained: float | None = None

    @property
    def name(self) -> str:
        return f"{self.test} · {self.channel.replace('_', ' ')}"

    def change(self) -> str:
        """ "2.10 → 0.340 deg"."""
        return f"{short(self.before.rms)} → {short(self.after.rms)} {self.unit or '1'}"

    def known(self) -> bool:
        """True where both models could be simulated."""
        return bool(np.isfinite(self.before.ratio) and np.isfinite(self.after.ratio))


Rows = Sequence[PredictionError]


def entries(
    fitted: Rows,
    held_out: Rows,
    before: tuple[Rows, Rows] | None = None,
    unknown: tuple[Rows, Rows] = ((), ()),
    share: Callable[[Rows], float | None] = lambda rows: None,
) -> tuple[Entry, ...]:
    """Held-out traces first, then the fitted ones, each in the order of the data.

    Args:
        fitted, held_out: errors of the final model.
        before: of the first model, likewise; None of a fit alone. A trace of another rig has no error afterwards.
        unknown: of the final model and a curve, likewise.
        share: of the motion that rows of one channel explain.
    """
    out = []
    for part, after in ((1, held_out), (0, fitted)):
        files = {row.file for row in after}
        now, then = grouped(after), grouped(unknown[part])
        was = now if before is None else grouped([row for row in before[part] if row.file in files])
        out += [Entry(*key, bool(part), Pool.of_rows(was[key]), Pool.of_rows(now[key]),
                      Pool.of_rows(then[key]) if key in then else None, share(now[key]))
                for key in was if key in now]  # fmt: skip
    return tuple(out)


def errors_table(rows: Sequence[Entry], compared: bool, file: str = "") -> Table:
    """Free-running errors by test and channel; before and after a diagnosis where two models are `compared`."""
    models = {"before": "before", "after": "after"} if compared else {"rms": "after"}

    def column(head: str, of: str, figure: str, spare: int = 0) -> Column:
        return Column(head, lambda row: short(getattr(getattr(row, of), figure, None)), spare=spare)

    columns = [
        Column("test", lambda row: row.test, "word"), Column("channel", lambda row: row.channel, "word"),
        Column("data", lambda row: role(row.held_out), "word"),
        Column("traces", lambda row: row.before.traces, spare=2),
        Column("samples", lambda row: row.before.samples, spare=1),
        *(column(head, of, "rms") for head, of in models.items()),
        *([] if compared else [column("sigma", "after", "sigma")]),
        Column("unit", lambda row: row.unit or "1", "unit"),
        *(column(f"{head}/sigma", of, "ratio") for head, of in models.items()),
    ]  # fmt: skip
    title, notes = "Free-running error, rms; sigma: noise of one sample", []
    if compared:
        title = "The ledger: free-running error, rms, before and after the diagnosis; sigma: noise of one sample"
    if any(row.unknown is not None for row in rows):
        notes = ["unknown: with a smooth curve for what no effect explains"]
        columns += [column("with unknown", "unknown", "rms", 4), column("unknown/sigma", "unknown", "ratio", 3)]
    if any(row.explained is not None for row in rows):
        columns.append(Column("explained %", lambda row: short(row.explained and 100.0 * row.explained, 4), spare=3))
    return Table(title, columns, rows, notes, keys=3, file=file)
