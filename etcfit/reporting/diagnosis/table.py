"""What `etcfit diagnose` prints: verdict, rounds, the ledger, parameters before and after, what stays open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from ...diagnosis.findings import Candidate, Diagnosis, RoundReport, SetTried, Statement
from ...diagnosis.probabilities import CALIBRATED, in_words
from ...estimation.intervals import Interval, intervals
from ...estimation.joint_fit import FitResult
from ..blocks import headed, plain_table, rig_title, sentences, spaced
from ..numbers import Digits, short
from ..tables import STATUS_STYLE
from .ledger import Entry, ledger

_SHOWN = 5  # candidates a round


def diagnosis_table(diagnosis: Diagnosis) -> RenderableType:
    """A diagnosis for stdout."""
    after = diagnosis.after
    model = " + ".join(["Eqs. 1-2", *diagnosis.final])
    parts = [
        rig_title(after.rig.config, model),
        sentences("Verdict", diagnosis.verdict),
        _how_sure(diagnosis),
        _ledger(ledger(diagnosis)),
        sentences("What no effect explains", _unexplained(diagnosis)),
        sentences("Effects that these data cannot tell apart", list(_ties(diagnosis))),
        _rounds(diagnosis.rounds),
        *(_candidates(k, each) for k, each in enumerate(diagnosis.rounds, start=1)),
        sentences("Looking back", [*diagnosis.removed, *map(_set, diagnosis.sets)]),
        _parameters(diagnosis.before, after),
        _outcome(after),
        sentences("Warnings", after.warnings),
    ]
    return Group(*(part for part in parts if part is not None))


def _ledger(entries: Sequence[Entry]) -> RenderableType:
    open_ends = any(entry.unknown is not None for entry in entries)
    heads = ["test", "channel", "data", "traces", "samples", "before", "after", "unit", "before/sigma", "after/sigma"]
    curve = ["with unknown", "unknown/sigma"] if open_ends else []
    table = plain_table(*heads, *curve, left=3, words=("unit",), spare=("samples", "traces", *curve[::-1]),
                        file="RUN/diagnosis.json")  # fmt: skip
    for entry in entries:
        table.add_row(*_ledger_row(entry), *(_unknown(entry) if open_ends else ()))
    title = "The ledger: free-running error, rms, before and after the diagnosis; sigma: noise of one sample"
    if open_ends:
        title += "; unknown: with a smooth curve for what no effect explains"
    return headed(title, table)


def _ledger_row(entry: Entry) -> tuple[str, ...]:
    before, after = entry.before, entry.after
    which = "held out" if entry.held_out else "fitted"
    count = str(before.traces), str(before.samples)
    errors = short(before.rms), short(after.rms), entry.unit or "1", short(before.ratio), short(after.ratio)
    return entry.test, entry.channel, which, *count, *errors


def _unknown(entry: Entry) -> tuple[str, str]:
    return ("-", "-") if entry.unknown is None else (short(entry.unknown.rms), short(entry.unknown.ratio))


def _how_sure(diagnosis: Diagnosis) -> RenderableType | None:
    """Each effect found, how sure it is, and what else could explain the same; then what is left at the end."""
    if not diagnosis.questions:
        return None
    at_last = diagnosis.questions[-1]
    parts: list[RenderableType] = [_stated(diagnosis.statements)] if diagnosis.statements else []
    parts += [Text(f"{at_last.asks} {in_words(at_last.answers)}."), Text(CALIBRATED, style="dim")]
    return headed("How sure", Group(*parts))


def _stated(statements: Sequence[Statement]) -> RenderableType:
    table = plain_table("effect", "how sure", "probability", "what else could be", "what would tell", left=2,
                        prose=("what else could be", "what would tell"), file="RUN/diagnosis.json")  # fmt: skip
    for each in statements:
        others = in_words(each.instead) or "nothing that was tried"
        table.add_row(each.effect, each.certainty, f"{each.probability:.2f}", others, each.told_by)
    return table


def _unexplained(diagnosis: Diagnosis) -> list[str]:
    unknown = diagnosis.unexplained
    if unknown is None:
        return []
    doubts = [f"In doubt beside it: {name}; the curve explains these data as well." for name in unknown.doubts]
    return [unknown.sentence, *doubts]


def _ties(diagnosis: Diagnosis) -> Iterator[str]:
    for tie in diagnosis.ties:
        yield (
            f"{' = '.join(tie.effects)}: the fits differ by at most {max(tie.apart):.2g} times the noise. "
            f"Told apart by: {tie.told_by}"
        )


def _set(tried: SetTried) -> str:
    """A set of effects that was refitted beside what the rounds found."""
    change = "does not compare" if tried.bic_change is None else f"BIC {tried.bic_change:+.1f}"
    return f"Also tried: {' + '.join(tried.effects)} ({change}), {'taken' if tried.taken else 'not taken'}."


def _rounds(rounds: Sequence[RoundReport]) -> RenderableType:
    """A line a round; the evidence of the first says what set it off."""
    lines = [Text(f"round {k}: {each.why}") for k, each in enumerate(rounds, start=1)]
    evidence = [Text(f"  {text}", style="dim") for text in (rounds[0].evidence.sentences if rounds else ())]
    return headed("Rounds", Group(*evidence, *lines))


def _candidates(k: int, each: RoundReport) -> RenderableType | None:
    if not each.candidates:
        return None
    table = plain_table("effect", "outcome", "screened gain", "fit ratio", "held-out ratio", "BIC", left=2,
                        spare=("screened gain",), file="RUN/diagnosis.json")  # fmt: skip
    for candidate in each.candidates[:_SHOWN]:
        table.add_row(*_candidate(candidate, each))
    rest = len(each.candidates) - _SHOWN
    return headed(f"Round {k}, candidates" + (f", the first {_SHOWN} of {_SHOWN + rest}" if rest > 0 else ""), table)


def _candidate(candidate: Candidate, each: RoundReport) -> tuple[str, ...]:
    if candidate.effect == each.added:
        mark = "added"
    elif candidate.effect in each.ties:
        mark = "tie"
    else:
        mark = "not taken" if candidate.refitted else "not refitted"
    bic = "-" if candidate.bic_change is None else f"{candidate.bic_change:+.1f}"
    ratios = short(candidate.fit_rms_ratio), short(candidate.holdout_rms_ratio)
    return candidate.effect, mark, short(candidate.screened), *ratios, bic


def _parameters(before: FitResult, after: FitResult) -> RenderableType:
    """The gear ratio is left out: nothing changes it."""
    was, now = intervals(before), intervals(after)
    units = {
        p.symbol: p.unit for p in (*before.free_parameters.layout.parameters, *after.free_parameters.layout.parameters)
    }
    table = plain_table(
        "parameter", "before", "95 % interval before", "after", "95 % interval after", "unit", "status",
        words=("unit",), prose=("status",), spare=("95 % interval before", "before"), file="RUN/fit.json",
    )  # fmt: skip
    for symbol in dict.fromkeys((*was, *now)):
        if symbol != "N":
            interval = now.get(symbol) or was[symbol]
            status = interval.status if symbol in now else "no longer there"
            status += f" ({interval.remark})" if interval.remark and symbol in now else ""
            table.add_row(symbol, *_figures(was.get(symbol)), *_figures(now.get(symbol)), units[symbol],
                          Text(status, style=STATUS_STYLE[interval.status]))  # fmt: skip
    return headed("Parameters before and after", table)


def _figures(i: Interval | None) -> tuple[str, str]:
    if i is None or i.status == "not identifiable":
        return "-", "-"
    digits = Digits.of(i.value, i.spread)
    return digits(i.value), digits.span(i.low, i.high)


def _outcome(after: FitResult) -> RenderableType:
    style = "bold green" if after.converged else "bold red"
    word = "The final fit converged" if after.converged else "THE FINAL FIT DID NOT CONVERGE"
    return spaced(Text.assemble((word, style), f": {after.reason}; chi2/dof {short(after.chi2_per_dof, 4)}"))
