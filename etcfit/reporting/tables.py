"""What a fit prints: rich renderables, drawn by whoever has a console."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.agreement import Pull
from ..estimation.explained import explained, motion_explained, share_of
from ..estimation.identifiability import listed
from ..estimation.identifiability import sentences as directions_in_words
from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import FitResult, StartSummary
from ..model.effects import PAPER
from ..problem.prediction_error import PredictionError
from ..rig.base import Measurement
from ..run_folder.fit import GEAR_RATIO, budget_json, readings_of
from .blocks import headed, plain_table, rig_title, sentences, spaced
from .blocks import render as render
from .numbers import Digits, short
from .pool import Pool

STATUS_STYLE = {
    "estimated": "",
    "fixed": "dim",
    "tied": "dim",
    "not identifiable": "bold red",
    "compromise": "bold red",
}


def fit_table(result: FitResult) -> RenderableType:
    """A fit for stdout: parameters, score, what is not identifiable, starts and warnings."""
    parts = [
        _parameters(result),
        _score("Free-running error, fitted traces", result.score_fit, result.rig.measurements),
        _score("Free-running error, held-out traces", result.score_holdout, result.rig.measurements),
        sentences(
            "What these data do not determine, or only roughly",
            directions_in_words(result.identifiability.directions, result.problem.batch.traces),
        ),
        influence_table(result),
        budget_table(result),
        _starts(result.starts),
        _outcome(result),
        sentences("Warnings", result.warnings),
    ]
    return Group(*(part for part in parts if part is not None))


def _parameters(result: FitResult) -> RenderableType:
    layout, read = result.free_parameters.layout, readings_of(result)
    declared = {p.symbol: (p.meaning, p.unit) for p in layout.parameters}
    declared |= {"N": (GEAR_RATIO.partition(",")[0], "1")} | {s: (lump.meaning, lump.unit) for s, lump in LUMPS.items()}
    table = plain_table(
        "parameter", "meaning", "reading", "fit", "95 % interval", "unit", "status",
        left=2, words=("unit",), prose=("meaning", "status"), spare=("meaning", "reading"), file="RUN/fit.json",
    )  # fmt: skip
    for symbol, interval in (intervals(result) | lumped(result)).items():
        meaning, unit = declared[symbol]
        table.add_row(*_parameter(symbol, meaning, unit, read.get(symbol), interval))
    return Group(
        rig_title(result.rig.config, f"{model_words(result)}, {len(result.problem.batch.traces)} traces"), table
    )


def model_words(result: FitResult) -> str:
    """Eqs. 1-2 and what was added."""
    return " + ".join(["Eqs. 1-2", *(t.name for t in result.free_parameters.layout.types if t not in PAPER)])


def _parameter(symbol: str, meaning: str, unit: str, read: float | None, i: Interval) -> Sequence[str | Text]:
    digits = Digits.of(i.value, i.spread)
    status = Text(i.status + (f" ({i.remark})" if i.remark else ""), style=STATUS_STYLE[i.status])
    lost = i.status == "not identifiable"
    value = "-" if lost else digits(i.value)
    return symbol, Text(meaning), short(read, 4), value, digits.span(i.low, i.high), unit, status


def _score(title: str, rows: Sequence[PredictionError], measurements: Sequence[Measurement]) -> RenderableType | None:
    """Pooled over the traces of a test: pictures and fit.json tell them apart."""
    table = plain_table(
        "test", "channel", "traces", "samples", "rms", "sigma", "rms/sigma", "explained %", "unit",
        left=2, words=("unit",), spare=("samples", "traces", "explained %"), file="RUN/fit.json",
    )  # fmt: skip

    def key(row: PredictionError) -> tuple[str, str, str]:
        return row.test, row.channel, row.unit

    for (test, channel, unit), group in groupby(sorted(rows, key=key), key=key):
        every = list(group)
        share = share_of(explained(every, measurements), (channel,))
        table.add_row(test, channel, *_pooled(every), "-" if share is None else short(100.0 * share, 4), unit)
    return headed(title, table) if table.row_count else None


def _pooled(rows: list[PredictionError]) -> tuple[str, ...]:
    pool = Pool.of(rows)
    return str(pool.traces), f"{pool.samples}", short(pool.rms), short(pool.sigma), short(pool.ratio)


def _starts(starts: Sequence[StartSummary]) -> RenderableType | None:
    table = plain_table("start", "before", "after", "steps", spare=("steps",), file="RUN/fit.json")
    for start in starts:
        table.add_row(start.name, short(start.chi2_before, 4), short(start.chi2_after, 4), str(start.steps))
    title = "Starts of the search: sum of squared residuals, each divided by its noise, before and after"
    return headed(title, table) if starts else None


def _outcome(result: FitResult) -> RenderableType:
    style = "bold green" if result.converged else "bold red"
    word = "Converged" if result.converged else "NOT CONVERGED"
    line = Text.assemble((word, style), f": {result.reason}; chi2/dof {short(result.chi2_per_dof, 4)}")
    said = motion_explained(result.score_fit, result.score_holdout, result.rig.measurements)
    return spaced(Group(line, Text(said)) if said else line)


STATISTICAL_ONLY = "Intervals are statistical only: rig.toml states no [accuracy] of its instruments."
_NAMED_SHARE = 0.01  # least share of the variance that is named


def budget_table(result: FitResult) -> RenderableType:
    """One row a parameter, one column a source; or that intervals are statistical only."""
    if result.budget is None:
        return spaced(Text(STATISTICAL_ONLY, style="dim"))
    table = plain_table(
        "parameter", "statistical standard error", "unit", "statistical share, %", "shares of the instruments",
        words=("unit",), prose=("shares of the instruments",), spare=("statistical standard error",),
        file="RUN/fit.json",
    )  # fmt: skip
    units = {parameter.symbol: parameter.unit for parameter in result.free_parameters.layout.parameters}
    for symbol, row in budget_json(result)["budget"].items():
        shares = dict(row["shares"])
        own = shares.pop("statistical")
        largest = sorted(((share, source) for source, share in shares.items() if share > _NAMED_SHARE), reverse=True)
        words = ", ".join(f"{source} {100.0 * share:.0f} %" for share, source in largest)
        table.add_row(symbol, short(row["stderr_statistical"]), units[symbol], f"{100.0 * own:.0f}", words)
    return headed("Where the uncertainty comes from, as shares of the variance", table)


_INFLUENCE = "Influence: the parameter that moves most when a test is left out, and by how many standard errors"


def influence_table(result: FitResult) -> RenderableType | None:
    """A row a test, those that pull hardest first; None where there is nothing to compare."""
    table = plain_table(
        "test", "parameter", "pull", "worst trace", "its pull",
        left=2, words=("worst trace",), paths=("worst trace",), spare=("its pull", "worst trace"), file="RUN/fit.json",
    )  # fmt: skip
    for test, hardest in _hardest(result).items():
        trace = _trace(result, hardest)
        of_trace = (trace.file, f"{trace.pull:+.1f}") if trace is not None else ("", "")
        table.add_row(test, hardest.parameter, f"{hardest.pull:+.1f}", *of_trace)
    if not table.row_count:
        return None
    alone = [Text(text, style="dim") for text in determined_alone(result)]
    return headed(_INFLUENCE, Group(table, *alone))


def determined_alone(result: FitResult) -> list[str]:
    """A sentence on each test, or file, without which parameters would not be known: nothing checks it on them."""
    by_part: dict[str, list[str]] = {}
    for symbol, part in result.influence.alone.items():
        by_part.setdefault(part, []).append(symbol)
    return [f"Only {part} determines {listed(symbols)}: no other test checks it." for part, symbols in by_part.items()]


def _hardest(result: FitResult) -> dict[str, Pull]:
    """The largest pull of each test as a whole."""
    out: dict[str, Pull] = {}
    for pull in result.influence.pulls:
        if pull.file is None:
            out.setdefault(pull.test, pull)
    return out


def _trace(result: FitResult, of: Pull) -> Pull | None:
    """The trace of a test that pulls hardest at the parameter which the test pulls most."""
    return next(
        (p for p in result.influence.pulls if p.file and (p.test, p.parameter) == (of.test, of.parameter)), None
    )
