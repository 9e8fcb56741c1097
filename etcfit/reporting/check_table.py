"""Output of `etcfit check` and `etcfit check --advise`, as rich renderables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..experiment.advice import Advice
from ..experiment.check import ChannelCheck, CheckResult, TraceCheck
from ..rig.base import Finding
from .blocks import PlainTable, dashed, headed, rig_title, shown, spaced, stacked
from .car_log import good_enough
from .numbers import short
from .table import Cell, Column, Kind, Notes, Table, of_texts, role


def check_table(result: CheckResult) -> RenderableType:
    """A check for stdout: every trace and channel, anomalies, and the parameters that these data identify."""
    return stacked(
        rig_title(result.rig.config, result.rig.folder),
        traces_table(result.traces),
        _channels(result.traces),
        *map(good_enough, result.follows),
        findings_table(result.rig.findings),
        Notes(
            "What looks odd in the records",
            [*_oddities(result), *(w for w in result.warnings if w not in map(str, result.rig.findings))],
        ),
        _identifiability(result),
    )


def traces_table(traces: Iterable[TraceCheck]) -> Table:
    """Clock and contents of each trace."""
    rows = [{"file": t.file, "test": t.test, "held_out": t.held_out, "samples": t.clock.samples,
             "duration": t.clock.duration, "rate": t.clock.rate, "gaps": t.clock.gaps, "jitter": t.clock.jitter,
             "longest": t.clock.longest, "channels": ", ".join(channel.name for channel in t.channels)}
            for t in traces]  # fmt: skip

    def gaps(row: Mapping[str, Any]) -> str:
        return f"{row['gaps']}, longest {short(row['longest'])} s" if row["gaps"] else "0"

    return Table("Traces", (
        Column("file", "file", "path"), Column("samples", "samples", spare=2),
        Column("duration s", "duration", spare=3, digits=4), Column("rate Hz", "rate", digits=4),
        Column("clock jitter %", lambda row: f"{100.0 * row['jitter']:.1f}"), Column("gaps", gaps),
        Column("use", lambda row: role(row["held_out"]), "word"),
        Column("channels", "channels", "prose", spare=1)), rows)  # fmt: skip


def _channels(traces: Iterable[TraceCheck]) -> Table:
    """Ranges over all traces of a test, which have the same sensors."""
    seen: dict[tuple[str, str, str], list[ChannelCheck]] = {}
    for trace in traces:
        for channel in trace.channels:
            seen.setdefault((trace.test, channel.name, channel.unit), []).append(channel)
    rows = []
    for (test, name, unit), same in seen.items():
        low, high = min(c.low for c in same), max(c.high for c in same)
        origin = "estimated" if same[0].estimated else "given"
        sigma = float(np.median([c.sigma for c in same]))
        quantum = short(same[0].quantum) if same[0].quantum else "-"
        rows.append((test, name, short(low, 4), short(high, 4), short(sigma), origin, quantum, unit or "1"))
    head = "test", "channel", "lowest", "highest", "noise", "noise is", "resolution", "unit"
    return of_texts("Channels", head, rows, 2, {"noise is": "word", "unit": "word"}, ("resolution", "noise is"))


def findings_table(findings: Sequence[Finding]) -> RenderableType | None:
    """Mistakes and habits of the rig itself, with the line that mends each; None if there are none."""
    if not findings:
        return None
    title = "Mistakes and habits of the rig, and what mends them"
    rows = [(f.kind, f.where, short(f.size, 4), f.unit, Cell("no fit takes it" if f.sure else "", "bad"))
            for f in findings]  # fmt: skip
    kinds: dict[str, Kind] = {"where": "path", "unit": "word", "effect on a fit": "word"}
    made = of_texts(title, ("kind", "where", "size", "unit", "effect on a fit"), rows, 2, kinds)
    texts = [line for f in findings for line in (*dashed([f.found]), Padding(Text(f.mend), (0, 0, 0, 4)))]
    return headed(title, Group(PlainTable(made), *texts))


def _oddities(result: CheckResult) -> list[str]:
    known_saturated = {(f.test, f.channel) for f in result.rig.findings if f.kind == "saturation"}
    out = []
    for trace in result.traces:
        for c in trace.channels:
            if c.frozen:
                out.append(f"{trace.file}: {c.name} never changes ({short(c.low, 4)} {c.unit}).")
            if c.clipped and (trace.test, c.name) not in known_saturated:
                out.append(f"{trace.file}: {c.name} rests on its lowest or highest value for {c.clipped} samples: "
                           "saturated or clipped.")  # fmt: skip
            if c.empty:
                out.append(f"{trace.file}: {c.name} has {c.empty} empty cells.")
    return out


def _identifiability(result: CheckResult) -> RenderableType:
    verdict = result.identifiability
    if verdict is None:
        return shown(Notes("Nothing can be fitted", [result.why_not]))
    head = Text("What these traces can identify (model of Eqs. 1-2, at values read off the graphs)", style="bold")
    values = "  ".join(short(s, 2) for s in verdict.singular_values)
    lost = ", ".join(verdict.lost)
    lines = [
        Text(f"  singular values (1/standard error of each combination of parameters): {values}"),
        Text(f"  not identifiable: {lost or 'none'}", style="bold red" if lost else ""),
        *dashed((*result.directions, *result.gains)),
    ]
    return spaced(Group(head, *lines))


_NOTED = 0.9  # a ratio of interval widths above this is printed dim


def advice_table(advice: Advice) -> RenderableType:
    """Advice for stdout."""
    return stacked(
        rig_title(advice.rig.config, "what one more trace would tell"),
        options_table(advice),
        _shares(advice),
        Notes("Not judged", [f"{test}: {why}." for test, why in advice.not_judged]),
    )


def options_table(advice: Advice) -> Table:
    """One more trace of each rig test, best first."""
    rows = [{"test": o.test, "how": o.says, "again": o.again, "mean": o.mean, "remark": o.remark,
             "separates": "" if o.separates is None else " and ".join(o.separates.symbols), "pair": o.separates}
            for o in advice.options]  # fmt: skip

    def apart(row: Mapping[str, Any]) -> str:
        pair = row["pair"]
        return "-" if pair is None else f"{row['separates']} (correlation {pair.before:.3f} -> {pair.after:.3f})"

    return Table("One more trace, best first; mean width: of all 95 % intervals after it, 1 is now", (
        Column("test", "test", "word"), Column("how", with_remark, "prose"),
        Column("mean width", lambda row: f"{row['mean']:.2f}"), Column("separates", apart, "prose", spare=1)),
        rows, file="advice.json of --out RUN")  # fmt: skip


def with_remark(row: Mapping[str, Any]) -> str:
    """How a trace is made, and the assumptions."""
    return row["how"] + (f" ({row['remark']})" if row["remark"] else "")


def _shares(advice: Advice) -> Table:
    """One row per parameter, one column per option."""
    head = [option.test + (", again" if option.again else ", new") for option in advice.options]
    rows = []
    for k, symbol in enumerate(advice.symbols):
        shares = [each.shrinks[k] for each in advice.options]
        cells = (Cell(f"{share:.2f}", "dim" if share > _NOTED else "strong") for share in shares)
        rows.append((symbol, short(100.0 * advice.sd[k], 2), *cells))
    return of_texts("Width of each 95 % interval after one more trace; 1 is its width now",
                    ("parameter", "standard error now, %", *head), rows)  # fmt: skip
