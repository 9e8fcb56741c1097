"""What `etcfit check` prints, and `etcfit check --advise`: rich renderables, drawn by whoever has a console."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..experiment.advice import Advice, Option, Pair
from ..experiment.check import ChannelCheck, CheckResult, TraceCheck
from ..rig.base import Finding
from .blocks import headed, plain_table, rig_title, sentences, spaced
from .car_log.tables import good_enough
from .numbers import short


def check_table(result: CheckResult) -> RenderableType:
    """A check for stdout: every trace and channel, what is odd, and what these data can identify."""
    parts = [
        rig_title(result.rig.config, result.rig.folder),
        _clocks(result.traces),
        _channels(result.traces),
        *(headed(f"{each.log.name}: good enough?", good_enough(each)) for each in result.follows),
        findings_table(result.rig.findings),
        sentences(
            "What looks odd in the records",
            [*_oddities(result), *(w for w in result.warnings if w not in map(str, result.rig.findings))],
        ),
        _identifiability(result),
    ]
    return Group(*(part for part in parts if part is not None))


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


_NOTED = 0.9  # an interval that shrinks to no less is printed dim


def advice_table(advice: Advice) -> RenderableType:
    """Advice for stdout."""
    parts = [
        rig_title(advice.rig.config, "what one more trace would tell"),
        _summary(advice),
        _shares(advice),
        sentences("Not judged", [f"{test}: {why}." for test, why in advice.not_judged]),
    ]
    return Group(*(part for part in parts if part is not None))


def _summary(advice: Advice) -> RenderableType:
    table = plain_table("test", "how", "mean width", "separates", prose=("how", "separates"), spare=("separates",),
                        file="advice.json of --out RUN")  # fmt: skip
    for option in advice.options:
        how = option.says + (f" ({option.remark})" if option.remark else "")
        table.add_row(option.test, how, f"{option.mean:.2f}", _pair(option.separates))
    return headed("One more trace, best first; mean width: of all 95 % intervals after it, 1 is now", table)


def _pair(pair: Pair | None) -> str:
    if pair is None:
        return "-"
    first, second = pair.symbols
    return f"{first} and {second} (correlation {pair.before:.3f} -> {pair.after:.3f})"


def _shares(advice: Advice) -> RenderableType:
    """A row a parameter, a column an option."""
    table = plain_table("parameter", "standard error now, %", *map(_label, advice.options))
    for k, symbol in enumerate(advice.symbols):
        table.add_row(symbol, short(100.0 * advice.sd[k], 2), *(_share(each.shrinks[k]) for each in advice.options))
    return headed("Width of each 95 % interval after one more trace; 1 is its width now", table)


def _label(option: Option) -> str:
    return option.test + (", again" if option.again else ", new")


def _share(share: float) -> Text:
    return Text(f"{share:.2f}", style="dim" if share > _NOTED else "bold")
