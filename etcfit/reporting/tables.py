"""A fit, of fit.json, for every view: parameters, what pulls at them, where their uncertainty comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.explained import explained, motion_explained, share_of
from ..estimation.identifiability import listed
from ..estimation.joint_fit import FitResult
from ..model.effects import PAPER
from ..run_folder.fit import fit_json
from .blocks import all_shown, outcome, rig_title, sentences, spaced, stacked
from .numbers import Digits, short
from .pool import entries, errors_table
from .table import Cell, Column, Notes, Part, Table, Tone, there

LOST, COMPROMISE = "not identifiable", "compromise"
STATUS_TONE: dict[str, Tone] = {"fixed": "dim", "tied": "dim", LOST: "bad", COMPROMISE: "bad"}
_FILE = "RUN/fit.json"
_Z_95 = 1.96


def fit_table(result: FitResult) -> RenderableType:
    """A fit for stdout: parameters, score, what is not identifiable, starts and warnings."""
    fit = fit_json(result, "parameters", "lumped", "influence", "only_told_by", "intervals", "budget",
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
    at_last = spaced(Group(ended, Text(said)) if said else ended), sentences("Warnings", result.warnings)
    return stacked(rig_title(rig.config, model), all_shown(*parts), *at_last)


def knowledge_parts(fit: Mapping[str, Any]) -> list[Part]:
    """What the data leave open, what each test pulls at, and where the uncertainty comes from."""
    open_ = [each["says"] for each in fit.get("not_identifiable") or ()]
    return there(Notes("What these data do not determine, or only roughly", open_), influence_table(fit),
                 *budget_parts(fit))  # fmt: skip


def parameter_rows(parameters: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A record a parameter: symbol, value, stderr, low, high (SI, 95 %), unit, status and what else its file says."""
    rows = []
    for symbol, each in parameters.items():
        low, high = each.get("ci95") or (None, None)
        spread = each.get("stderr")
        if spread is None and low is not None and high is not None:  # of a range without one: for the digits alone
            spread = (high - low) / (2.0 * _Z_95)
        rows.append({**each, "symbol": symbol, "low": low, "high": high, "digits": spread})
    return rows


def parameters_table(
    parameters: Mapping[str, Mapping[str, Any]], lumped: Mapping[str, Mapping[str, Any]], title: str = "Parameters"
) -> Table:
    """Every parameter, and combinations that may be known where their parts are not; what is not identifiable gets no
    number."""

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
    """Of a parameter, with what is remarked of it."""
    remark = f" ({row['remark']})" if row.get("remark") else ""
    return Cell(row["status"] + remark, STATUS_TONE.get(row["status"], ""))


def model_words(result: FitResult) -> str:
    """Eqs. 1-2 and what was added."""
    return " + ".join(["Eqs. 1-2", *(t.name for t in result.free_parameters.layout.types if t not in PAPER)])


STATISTICAL_ONLY = "Intervals are statistical only: rig.toml states no [accuracy] of its instruments."
_NAMED_SHARE = 0.01  # least share of the variance that is named


def budget_parts(fit: Mapping[str, Any]) -> list[Part]:
    """One row a parameter, its largest sources; or that intervals are statistical only."""
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
    """A row a test, those that pull hardest first, and the trace that pulls hardest at the same parameter; None where
    there is nothing to compare."""
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
    title = "Influence: what leaving out a test or a trace would move most, and by how many standard errors"
    return Table(title, columns, list(rows.values()), _alone(fit), keys=2, file=_FILE) if rows else None


def _alone(fit: Mapping[str, Any]) -> list[str]:
    """A sentence on each test, or file, without which parameters would not be known: nothing checks it on them."""
    by_part: dict[str, list[str]] = {}
    for symbol, part in (fit.get("only_told_by") or {}).items():
        by_part.setdefault(part, []).append(symbol)
    return [f"Only {part} determines {listed(symbols)}: no other test checks it." for part, symbols in by_part.items()]
