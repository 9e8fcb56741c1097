"""A fit, of fit.json, for every view: parameters, influence of tests on them, sources of their uncertainty.

Also the pooled errors of many traces, with their table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.explained import explained, motion_explained, share_of
from ..estimation.identifiability import listed
from ..estimation.joint_fit import FitResult
from ..model.effects import PAPER
from ..problem.prediction_error import PredictionError, pooled
from ..run_folder.fit import FIT
from .blocks import outcome, rig_title, spaced, stacked
from .numbers import Digits, short
from .table import Cell, Column, Notes, Part, Table, Tone, role, there

LOST, COMPROMISE = "not identifiable", "compromise"
STATUS_TONE: dict[str, Tone] = {"fixed": "dim", "tied": "dim", LOST: "bad", COMPROMISE: "bad"}
_FILE = "RUN/fit.json"
_Z_95 = 1.96


def fit_table(result: FitResult) -> RenderableType:
    """A fit for stdout: parameters, score, what is not identifiable, starts and warnings."""
    fit = FIT.json(result, "parameters", "lumped", "influence", "only_told_by", "intervals", "budget",
                      "not_identifiable")  # fmt: skip
    ended = outcome(result.converged, ("Converged", "NOT CONVERGED"),
                    f"{result.reason}; chi2/dof {short(result.chi2_per_dof, 4)}")  # fmt: skip
    rig, model = result.rig, f"{model_words(result)}, {len(result.problem.batch.traces)} traces"
    said = motion_explained(result.score_fit, result.score_holdout, rig.measurements)
    errors = errors_table(
        entries(result.score_fit, result.score_holdout,
                share=lambda rows: share_of(explained(rows, rig.measurements), (rows[0].channel,))),
        False, _FILE)  # fmt: skip
    starts = Table("Starts of the search: sum of squared residuals, each divided by its noise, before and after", (
        Column("start", "name", "word"), Column("before", "chi2_before", digits=4),
        Column("after", "chi2_after", digits=4), Column("steps", "steps", spare=1)),
        [asdict(start) for start in result.starts], file=_FILE)  # fmt: skip
    parts = parameters_table(fit["parameters"], fit["lumped"]), errors, *knowledge_parts(fit), starts
    at_last = spaced(Group(ended, Text(said)) if said else ended), Notes("Warnings", result.warnings)
    return stacked(rig_title(rig.config, model), *parts, *at_last)


def knowledge_parts(fit: Mapping[str, Any]) -> list[Part]:
    """Undetermined directions, the influence of each test, and the sources of uncertainty."""
    open_ = [each["says"] for each in fit.get("not_identifiable") or ()]
    return there(Notes("What these data do not determine, or only roughly", open_), influence_table(fit),
                 *budget_parts(fit))  # fmt: skip


def parameter_rows(parameters: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One record per parameter: symbol, value, stderr, low, high (SI, 95 %), unit, status and further keys of its
    file."""
    rows = []
    for symbol, each in parameters.items():
        low, high = each.get("ci95") or (None, None)
        spread = each.get("stderr")
        if spread is None and low is not None and high is not None:  # for a range: only for the number of digits
            spread = (high - low) / (2.0 * _Z_95)
        rows.append({**each, "symbol": symbol, "low": low, "high": high, "digits": spread})
    return rows


def parameters_table(
    parameters: Mapping[str, Mapping[str, Any]], lumped: Mapping[str, Mapping[str, Any]], title: str = "Parameters"
) -> Table:
    """Every parameter, and combinations that may be known although their parts are not; no number if not
    identifiable."""

    def digits(row: Mapping[str, Any]) -> Digits:
        return Digits.of_value(row["value"], row["digits"])

    every = (*parameters.values(), *lumped.values())
    unsure = any(each["status"] == COMPROMISE for each in every)
    said = "; of a compromise the interval is the range that subsets of the data give, not a statistical one"
    columns = (
        Column("parameter", "symbol", "symbol"),
        Column("meaning", "meaning", "prose", spare=1),
        Column("reading", lambda row: short(row.get("reading"), 4), spare=3),
        Column("value", lambda row: "-" if row["status"] == LOST else digits(row)(row["value"])),
        Column("std. error", lambda row: "-" if row["stderr"] is None else digits(row)(row["stderr"]), spare=2),
        Column("95 % interval", lambda row: digits(row).span(row["low"], row["high"])),
        Column("unit", "unit", "unit"),
        Column("status", status_cell, "prose"),
    )
    return Table(title + (said if unsure else ""), columns, parameter_rows({**parameters, **lumped}), file=_FILE)


def status_cell(row: Mapping[str, Any]) -> Cell:
    """Status of a parameter, with its remark."""
    remark = f" ({row['remark']})" if row.get("remark") else ""
    return Cell(row["status"] + remark, STATUS_TONE.get(row["status"], ""))


def model_words(result: FitResult) -> str:
    """Eqs. 1-2 and added effects."""
    return " + ".join(["Eqs. 1-2", *(t.name for t in result.free_parameters.layout.types if t not in PAPER)])


STATISTICAL_ONLY = "Intervals are statistical only: rig.toml states no [accuracy] of its instruments."
_NAMED_SHARE = 0.01  # least share of the variance of a named source


def budget_parts(fit: Mapping[str, Any]) -> list[Part]:
    """One row per parameter with its largest sources; or a note that intervals are statistical only."""
    title, budget = "Where the uncertainty comes from, as shares of the variance", fit.get("budget")
    if not budget:
        return [Notes(title, [STATISTICAL_ONLY])] if fit.get("intervals") == "statistical only" else []

    def largest(row: Mapping[str, Any]) -> str:
        shares = sorted(((share, source) for source, share in row["shares"].items()
                         if source != "statistical" and share > _NAMED_SHARE), reverse=True)  # fmt: skip
        return ", ".join(f"{source} {100.0 * share:.0f} %" for share, source in shares)

    rows = [{"symbol": symbol, "unit": fit["parameters"][symbol]["unit"], **row} for symbol, row in budget.items()]
    return [Table(title, (
        Column("parameter", "symbol", "symbol"), Column("statistical standard error", "stderr_statistical", spare=1),
        Column("unit", "unit", "unit"),
        Column("statistical share, %", lambda row: f"{100.0 * row['shares']['statistical']:.0f}"),
        Column("shares of the instruments", largest, "prose")), rows, file=_FILE)]  # fmt: skip


def influence_table(fit: Mapping[str, Any]) -> Table | None:
    """One row per test, the largest pulls first, with the trace of the largest pull on the same parameter; None without
    a comparison."""
    pulls, rows = fit.get("influence") or (), {}
    for pull in pulls:
        if pull["file"] is None and pull["test"] not in rows:
            place = pull["test"], pull["parameter"]
            one = next((p for p in pulls if p["file"] and (p["test"], p["parameter"]) == place), None)
            rows[pull["test"]] = {**pull, "worst": "" if one is None else one["file"],
                                  "its": "" if one is None else f"{one['pull']:+.1f}"}  # fmt: skip
    columns = (Column("test", "test", "word"), Column("parameter", "parameter", "symbol"),
               Column("pull", lambda row: f"{row['pull']:+.1f}"), Column("worst trace", "worst", "path", spare=2),
               Column("its pull", "its", spare=1))  # fmt: skip
    by_part: dict[str, list[str]] = {}
    for symbol, part in (fit.get("only_told_by") or {}).items():
        by_part.setdefault(part, []).append(symbol)
    alone = [f"Only {part} determines {listed(symbols)}: no other test checks it." for part, symbols in by_part.items()]
    title = "Influence: what leaving out a test or a trace would move most, and by how many standard errors"
    return Table(title, columns, list(rows.values()), alone, keys=2, file=_FILE) if rows else None


@dataclass(frozen=True)
class Pool:
    """Root mean squares over traces, each counting for its samples.

    rms^2 = sum n_k rms_k^2 / sum n_k,    likewise sigma and ratio = rms / sigma
    """

    # traces, samples: numbers of these
    traces: int
    samples: int
    # rms, sigma: in the unit of the rows
    rms: float
    sigma: float
    ratio: float  # ratio of rms and sigma, pooled row by row

    @classmethod
    def of_rows(cls, rows: Sequence[PredictionError]) -> Pool:
        """Pool rows of one unit; with several units only the ratio has a meaning."""
        n = np.array([row.n for row in rows], dtype=float)

        def mean(values: list[float]) -> float:
            return float(np.sqrt(np.sum(n * np.array(values) ** 2) / n.sum()))

        rms, sigma = mean([row.rms for row in rows]), mean([row.sigma for row in rows])
        return cls(len(rows), int(n.sum()), rms, sigma, pooled(rows))


def grouped(rows: Sequence[PredictionError]) -> dict[tuple[str, str, str], list[PredictionError]]:
    """Rows by test, channel and unit, in their order."""
    groups: dict[tuple[str, str, str], list[PredictionError]] = {}
    for row in rows:
        groups.setdefault((row.test, row.channel, row.unit), []).append(row)
    return groups


@dataclass(frozen=True)
class Entry:
    """One channel of one test, all its traces pooled."""

    # test, channel, unit, held_out: the channel; the unit in output
    test: str
    channel: str
    unit: str
    held_out: bool
    # before, after: errors of the first and of the final model; without a diagnosis both are those of the fit
    before: Pool
    after: Pool
    # error of the final model with a smooth curve for the unexplained part; None without one
    unknown: Pool | None = None
    explained: float | None = None  # explained share of the motion, 0 to 1; None if not known

    @property
    def name(self) -> str:
        return f"{self.test} · {self.channel.replace('_', ' ')}"

    def change(self) -> str:
        """ "2.10 → 0.340 deg"."""
        return f"{short(self.before.rms)} → {short(self.after.rms)} {self.unit or '1'}"

    def known(self) -> bool:
        """Whether both models could be simulated."""
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
        before: errors of the first model; None without a diagnosis. A trace of another rig has no error afterwards.
        unknown: errors of the final model with a curve.
        share: share of the motion that rows of one channel explain.
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
    """Free-running errors by test and channel; before and after a diagnosis if two models are `compared`."""
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
