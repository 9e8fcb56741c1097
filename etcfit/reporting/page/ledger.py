"""Free-running errors of test and channel: of the fit alone, or before and after the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ...problem.prediction_error import PredictionError
from ..pool import Pool
from .contents import Contents, rows_of
from .table import Table
from .typeset import number, unit

Key = tuple[str, str, str]


def ledger_table(contents: Contents) -> Table:
    """Held-out traces first, then the fitted ones; each channel of each test pooled over its traces."""
    diagnosis = contents.get("diagnosis")
    if not diagnosis:
        return _alone(contents.files["fit"]["score"])
    head = ["test", "channel", "", "traces", "before", "after", "unit", "before, σ", "after, σ"]
    rows = [
        (test, channel.replace("_", " "), which, was.traces, number(was.rms), number(now.rms), unit(of),
         number(was.ratio), number(now.ratio))
        for which, part in (("held out", "holdout"), ("fitted", "fit"))
        for (test, channel, of), was, now in _pairs(diagnosis["before"][part], diagnosis["after"][part])
    ]  # fmt: skip
    return Table("Free-running error, rms, before and after the diagnosis; σ is the noise of one sample", head, rows, 3)


def _alone(score: Mapping[str, Any]) -> Table:
    head = ["test", "channel", "", "traces", "rms", "unit", "rms, σ"]
    rows = [
        (test, channel.replace("_", " "), which, pool.traces, number(pool.rms), unit(of), number(pool.ratio))
        for which, part in (("held out", "holdout"), ("fitted", "fit"))
        for (test, channel, of), pool in _pools(score[part]).items()
    ]
    return Table("Free-running error of the fit, rms; σ is the noise of one sample", head, rows, 3)


def _pairs(before: Any, after: Any) -> Iterable[tuple[Key, Pool, Pool]]:
    shared = {row["file"] for row in after}  # a trace of another rig has no error afterwards
    was, now = _pools([row for row in before if row["file"] in shared]), _pools(after)
    return ((key, was[key], now[key]) for key in was if key in now)


def _pools(rows: Any) -> dict[Key, Pool]:
    groups: dict[Key, list[PredictionError]] = {}
    for row in rows_of(rows):
        groups.setdefault((row.test, row.channel, row.unit), []).append(row)
    return {key: Pool.of(group) for key, group in groups.items()}
