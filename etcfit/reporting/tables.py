"""What the commands print: rich renderables, drawn by whoever has a console."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import FitResult, StartSummary
from ..estimation.remedies import sentences as directions_in_words
from ..experiment.check import ChannelCheck, CheckResult, TraceCheck
from ..model.effects import PAPER
from ..problem.prediction_error import PredictionError
from ..rig.finding import Finding
from ..run_folder import GEAR_RATIO, readings_of
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
        _score("Free-running error, fitted traces", result.score_fit),
        _score("Free-running error, held-out traces", result.score_holdout),
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


def check_table(result: CheckResult) -> RenderableType:
    """A check for stdout: every trace and channel, what is odd, and what these data can identify."""
    parts = [
        rig_title(result.rig.config, result.rig.folder),
        _clocks(result.traces),
        _channels(result.traces),
        findings_table(result.rig.findings),
        sentences(
            "What looks odd in the records",
            [*_oddities(result), *(w for w in result.warnings if w not in map(str, result.rig.findings))],
        ),
        _identifiability(result),
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


def _score(title: str, rows: Iterable[PredictionError]) -> RenderableType | None:
    """Pooled over the traces of a test: pictures and fit.json tell them apart."""
    table = plain_table(
        "test", "channel", "traces", "samples", "rms", "sigma", "rms/sigma", "unit",
        left=2, words=("unit",), spare=("samples", "traces"), file="RUN/fit.json",
    )  # fmt: skip

    def key(row: PredictionError) -> tuple[str, str, str]:
        return row.test, row.channel, row.unit

    for (test, channel, unit), group in groupby(sorted(rows, key=key), key=key):
        table.add_row(test, channel, *_pooled(list(group)), unit)
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
    return spaced(Text.assemble((word, style), f": {result.reason}; chi2/dof {short(result.chi2_per_dof, 4)}"))


def _clocks(traces: Iterable[TraceCheck]) -> RenderableType:
    table = plain_table(
        "file", "samples", "duration s", "rate Hz", "clock jitter %", "gaps", "use",
        words=("use",), paths=("file",), spare=("samples", "duration s"),
    )  # fmt: skip
    for trace in traces:
        c = trace.clock
        gaps = f"{c.gaps}, longest {short(c.longest)} s" if c.gaps else "0"
        jitter = f"{100.0 * c.jitter:.1f}"
        table.add_row(trace.file, str(c.samples), short(c.duration, 4), short(c.rate, 4), jitter, gaps,
                      "held out" if trace.held_out else "fitted")  # fmt: skip
    return headed("Traces", table)


def _channels(traces: Iterable[TraceCheck]) -> RenderableType:
    """Ranges pooled over the traces of a test: the same sensors saw them."""
    table = plain_table(
        "test", "channel", "lowest", "highest", "noise", "noise is", "resolution", "unit",
        left=2, words=("noise is", "unit"), spare=("resolution", "noise is"),
    )  # fmt: skip
    seen: dict[tuple[str, str, str], list[ChannelCheck]] = {}
    for trace in traces:
        for channel in trace.channels:
            seen.setdefault((trace.test, channel.name, channel.unit), []).append(channel)
    for (test, name, unit), same in seen.items():
        low, high = min(c.low for c in same), max(c.high for c in same)
        origin = "estimated" if same[0].estimated else "given"
        sigma = float(np.median([c.sigma for c in same]))
        quantum = short(same[0].quantum) if same[0].quantum else "-"
        table.add_row(test, name, short(low, 4), short(high, 4), short(sigma), origin, quantum, unit or "1")
    return headed("Channels", table)


def findings_table(findings: Sequence[Finding]) -> RenderableType | None:
    """Mistakes and habits of the rig itself, and the line that mends each; None where none was found."""
    table = plain_table("kind", "where", "size", "unit", "effect on a fit", left=2, words=("unit", "effect on a fit"),
                        paths=("where",))  # fmt: skip
    for finding in findings:
        word = Text("no fit takes it", style="bold red") if finding.sure else Text("")
        table.add_row(finding.kind, finding.where, short(finding.size, 4), finding.unit, word)
    texts = [line for f in findings for line in (Padding(Text(f"- {f.found}"), (0, 0, 0, 2)),
                                                 Padding(Text(f.mend), (0, 0, 0, 4)))]  # fmt: skip
    return headed("Mistakes and habits of the rig, and what mends them", Group(table, *texts)) if findings else None


def _oddities(result: CheckResult) -> list[str]:
    told = {(f.test, f.channel) for f in result.rig.findings if f.kind == "saturation"}
    out = []
    for trace in result.traces:
        for c in trace.channels:
            if c.frozen:
                out.append(f"{trace.file}: {c.name} never changes ({short(c.low, 4)} {c.unit}).")
            if c.clipped and (trace.test, c.name) not in told:
                out.append(f"{trace.file}: {c.name} rests on its lowest or highest value for {c.clipped} samples: "
                           "saturated or clipped.")  # fmt: skip
            if c.empty:
                out.append(f"{trace.file}: {c.name} has {c.empty} empty cells.")
    return out


def _identifiability(result: CheckResult) -> RenderableType:
    verdict = result.identifiability
    if verdict is None:
        return sentences("Nothing can be fitted", [result.why_not]) or Text("Nothing can be fitted")
    head = Text("What these traces can identify (model of Eqs. 1-2, at values read off the graphs)", style="bold")
    values = "  ".join(short(s, 2) for s in verdict.singular_values)
    lost = ", ".join(verdict.lost)
    lines = [
        Text(f"  singular values (1/standard error of each combination of parameters): {values}"),
        Text(f"  not identifiable: {lost or 'none'}", style="bold red" if lost else ""),
        *(Padding(Text(f"- {text}"), (0, 0, 0, 2)) for text in (*result.directions, *result.gains)),
    ]
    return spaced(Group(head, *lines))
