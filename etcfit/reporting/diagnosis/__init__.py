"""Output of a diagnosis: that of `etcfit diagnose`, and the tables of diagnosis.json for every view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import RenderableType

from ...diagnosis.findings import Diagnosis
from ...diagnosis.probabilities import CALIBRATED, likely_in_one_line
from ...estimation.intervals import Interval, intervals
from ...estimation.joint_fit import FitResult
from ...run_folder.diagnosis import DIAGNOSIS
from ..blocks import outcome, rig_title, spaced, stacked
from ..numbers import Digits, short
from ..table import Column, Kind, Notes, Part, Table, of_texts, there
from ..tables import LOST, errors_table, status_cell

Found = Mapping[str, Any]  # diagnosis.json
_FILE = "RUN/diagnosis.json"
_KEYS = ("statements", "questions", "unexplained", "ties", "ties_apart", "ties_told_by", "rounds", "removed", "sets")
_SHOWN = 5  # candidates per round


def diagnosis_table(diagnosis: Diagnosis) -> RenderableType:
    """A diagnosis for stdout."""
    from .ledger import ledger  # it imports the drawing modules

    after, found = diagnosis.after, DIAGNOSIS.json(diagnosis, *_KEYS)
    ended = "The final fit converged", "THE FINAL FIT DID NOT CONVERGE"
    return stacked(
        rig_title(after.rig.config, " + ".join(["Eqs. 1-2", *diagnosis.final])),
        Notes("Verdict", diagnosis.verdict),
        how_sure(found),
        errors_table(ledger(diagnosis), True, _FILE),
        *diagnosis_parts(found),
        _parameters(diagnosis.before, after),
        spaced(outcome(after.converged, ended, f"{after.reason}; chi2/dof {short(after.chi2_per_dof, 4)}")),
        Notes("Warnings", after.warnings),
    )


def how_sure(found: Found) -> Part:
    """Each effect found, its probability, and alternatives; the answers to every question."""
    said = [f"{each['asks']} {likely_in_one_line(each['answers'])}." for each in found.get("questions") or ()]
    if said:
        said.append(f"Answers to one question exclude each other: their probabilities add up to one. {CALIBRATED}")
    rows = [(each["effect"], each["certainty"], f"{each['probability']:.2f}",
             likely_in_one_line(each["instead"]) or "nothing that was tried", each["told_by"])
            for each in found.get("statements") or () if "certainty" in each]  # fmt: skip
    if not rows:
        return Notes("How sure", said)
    prose: dict[str, Kind] = {"what else could be": "prose", "what would tell": "prose"}
    return of_texts("How sure", ("effect", "how sure", "probability", *prose), rows, 2, prose, notes=said, file=_FILE)


def diagnosis_parts(found: Found) -> list[Part]:
    """The unexplained part, indistinguishable effects, the rounds with their candidates, and removed effects."""
    left, rounds = found.get("unexplained"), found.get("rounds") or ()
    unknown = [left.get("sentence") or f"A {left['enters']} that depends on {left['depends_on']}."] if left else []
    evidence = rounds[0].get("evidence_says") or () if rounds else ()  # it set the first round off
    turns = [f"round {k}: {each['why']}" for k, each in enumerate(rounds, start=1)]
    return there(
        Notes("What no effect explains", unknown),
        Notes("Effects that these data cannot tell apart", _ties(found)),
        Notes("Rounds", [*evidence, *turns]),
        *(_candidates(k, each) for k, each in enumerate(rounds, start=1)),
        Notes("Looking back", [*(found.get("removed") or ()), *map(_set, found.get("sets") or ())]),
    )


def _ties(found: Found) -> list[str]:
    ties = found.get("ties") or ()
    apart, told_by = (found.get(key) or [None] * len(ties) for key in ("ties_apart", "ties_told_by"))
    differ = ("" if each is None else f": the fits differ by at most {max(each):.2g} times the noise" for each in apart)
    tell = ("" if each is None else f". Told apart by: {each}" for each in told_by)
    return [" = ".join(tie) + far + by for tie, far, by in zip(ties, differ, tell, strict=True)]


def _set(tried: Mapping[str, Any]) -> str:
    """Effects that were refitted in addition to those of the rounds."""
    outcome = "taken" if tried["taken"] else "not taken"
    return f"Also tried: {' + '.join(tried['effects'])} (BIC {tried['bic_change']:+.1f}), {outcome}."


def _candidates(k: int, each: Mapping[str, Any]) -> Table:
    """The most promising candidates of a round, with their outcome."""

    def mark(row: Mapping[str, Any]) -> str:
        if row["effect"] == each["added"]:
            return "added"
        if row["effect"] in (each.get("ties") or ()):
            return "tie"
        return "not taken" if row.get("refitted") else "not refitted"

    def bic(row: Mapping[str, Any]) -> str:
        return "-" if row["bic_change"] is None else f"{row['bic_change']:+.1f}"

    every = each["candidates"]
    title = f"Round {k}, candidates" + (f", the first {_SHOWN} of {len(every)}" if len(every) > _SHOWN else "")
    return Table(title, (
        Column("effect", "effect", "word"), Column("outcome", mark, "word"),
        Column("screened gain", lambda row: row.get("screened"), spare=1), Column("fit ratio", "fit_rms_ratio"),
        Column("held-out ratio", "holdout_rms_ratio"), Column("BIC", bic)),
        every[:_SHOWN], keys=2, file=_FILE)  # fmt: skip


def _parameters(before: FitResult, after: FitResult) -> Table:
    """Parameters without the gear ratio, which does not change."""
    was, now = intervals(before), intervals(after)
    units = {p.symbol: p.unit for fit in (before, after) for p in fit.free_parameters.layout.parameters}
    rows = []
    for symbol in dict.fromkeys((*was, *now)):
        if symbol != "N":
            last = now.get(symbol) or was[symbol]
            status = status_cell({"status": last.status, "remark": symbol in now and last.remark})
            rows.append((symbol, *_figures(was.get(symbol)), *_figures(now.get(symbol)), units[symbol],
                         status if symbol in now else status._replace(text="no longer there")))  # fmt: skip
    columns = (Column("parameter", 0, "symbol"), Column("before", 1, spare=2),
               Column("95 % interval before", 2, spare=1), Column("after", 3), Column("95 % interval after", 4),
               Column("unit", 5, "unit"), Column("status", 6, "prose"))  # fmt: skip
    return Table("Parameters before and after", columns, rows, file="RUN/fit.json")


def _figures(i: Interval | None) -> tuple[str, str]:
    if i is None or i.status == LOST:
        return "-", "-"
    digits = Digits.of_value(i.value, i.spread)
    return digits(i.value), digits.span(i.low, i.high)
