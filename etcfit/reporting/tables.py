"""What a fit prints: rich renderables, drawn by whoever has a console."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.explained import explained, motion_explained, share_of
from ..estimation.identifiability import sentences as directions_in_words
from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import FitResult, StartSummary
from ..model.effects import PAPER
from ..problem.prediction_error import PredictionError
from ..rig.base import Measurement
from ..run_folder.fit import GEAR_RATIO, readings_of
from .blocks import headed, plain_table, rig_title, sentences, spaced
from .blocks import render as render
from .budget import budget_table
from .influence import influence_table
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
