"""What a person sees of a diagnosis: what `etcfit diagnose` prints."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from ...diagnosis.findings import Candidate, Diagnosis, RoundReport, Statement
from ...diagnosis.probabilities import CALIBRATED, likely_in_one_line
from ...estimation.intervals import Interval, intervals
from ...estimation.joint_fit import FitResult
from ..blocks import filled, headed, outcome, rig_title, sentences, spaced, stacked, table
from ..numbers import Digits, short
from ..tables import STATUS_STYLE
from .ledger import Entry, ledger

_FILE = "RUN/diagnosis.json"
_SHOWN = 5  # candidates a round


def diagnosis_table(diagnosis: Diagnosis) -> RenderableType:
    """A diagnosis for stdout."""
    after = diagnosis.after
    ties = [f"{' = '.join(tie.effects)}: the fits differ by at most {max(tie.apart):.2g} times the noise. "
            f"Told apart by: {tie.told_by}" for tie in diagnosis.ties]  # fmt: skip
    sets = []  # of effects that were refitted beside what the rounds found
    for tried in diagnosis.sets:
        change = "does not compare" if tried.bic_change is None else f"BIC {tried.bic_change:+.1f}"
        taken = "taken" if tried.taken else "not taken"
        sets.append(f"Also tried: {' + '.join(tried.effects)} ({change}), {taken}.")
    model = " + ".join(["Eqs. 1-2", *diagnosis.final])
    ended = "The final fit converged", "THE FINAL FIT DID NOT CONVERGE"
    return stacked(
        rig_title(after.rig.config, model),
        sentences("Verdict", diagnosis.verdict),
        _how_sure(diagnosis),
        _ledger(ledger(diagnosis)),
        sentences("What no effect explains", _unexplained(diagnosis)),
        sentences("Effects that these data cannot tell apart", ties),
        _rounds(diagnosis.rounds),
        *(_candidates(k, each) for k, each in enumerate(diagnosis.rounds, start=1)),
        sentences("Looking back", [*diagnosis.removed, *sets]),
        _parameters(diagnosis.before, after),
        spaced(outcome(after.converged, ended, f"{after.reason}; chi2/dof {short(after.chi2_per_dof, 4)}")),
        sentences("Warnings", after.warnings),
    )


def _ledger(entries: Sequence[Entry]) -> RenderableType | None:
    """One row a test and channel; the errors with a curve for what no effect explains where there is one."""
    curve = ("with unknown", "unknown/sigma") if any(entry.unknown is not None for entry in entries) else ()
    rows = []
    for e in entries:
        errors = short(e.before.rms), short(e.after.rms), e.unit or "1", short(e.before.ratio), short(e.after.ratio)
        unknown = ("-", "-") if e.unknown is None else (short(e.unknown.rms), short(e.unknown.ratio))
        rows.append((e.test, e.channel, "held out" if e.held_out else "fitted", str(e.before.traces),
                     str(e.before.samples), *errors, *unknown[: len(curve)]))  # fmt: skip
    title = "The ledger: free-running error, rms, before and after the diagnosis; sigma: noise of one sample"
    title += "; unknown: with a smooth curve for what no effect explains" if curve else ""
    head = "test", "channel", "data", "traces", "samples", "before", "after", "unit", "before/sigma", "after/sigma"
    made = filled((*head, *curve), rows, left=3, words=("unit",), spare=("samples", "traces", *curve[::-1]), file=_FILE)
    return headed(title, made)


def _how_sure(diagnosis: Diagnosis) -> RenderableType | None:
    """Each effect found, how sure it is, and what else could explain the same; then what is left at the end."""
    if not diagnosis.questions:
        return None
    at_last = diagnosis.questions[-1]
    parts: list[RenderableType] = [_stated(diagnosis.statements)] if diagnosis.statements else []
    parts += [Text(f"{at_last.asks} {likely_in_one_line(at_last.answers)}."), Text(CALIBRATED, style="dim")]
    return headed("How sure", Group(*parts))


def _stated(statements: Sequence[Statement]) -> RenderableType:
    rows = [(each.effect, each.certainty, f"{each.probability:.2f}",
             likely_in_one_line(each.instead) or "nothing that was tried", each.told_by)
            for each in statements]  # fmt: skip
    head = "effect", "how sure", "probability", "what else could be", "what would tell"
    return filled(head, rows, left=2, prose=("what else could be", "what would tell"), file=_FILE)


def _unexplained(diagnosis: Diagnosis) -> list[str]:
    unknown = diagnosis.unexplained
    if unknown is None:
        return []
    doubts = [f"In doubt beside it: {name}; the curve explains these data as well." for name in unknown.doubts]
    return [unknown.sentence, *doubts]


def _rounds(rounds: Sequence[RoundReport]) -> RenderableType:
    """A line a round; the evidence of the first says what set it off."""
    lines = [Text(f"round {k}: {each.why}") for k, each in enumerate(rounds, start=1)]
    evidence = [Text(f"  {text}", style="dim") for text in (rounds[0].evidence.sentences if rounds else ())]
    return headed("Rounds", Group(*evidence, *lines))


def _candidates(k: int, each: RoundReport) -> RenderableType | None:
    rest = len(each.candidates) - _SHOWN
    title = f"Round {k}, candidates" + (f", the first {_SHOWN} of {_SHOWN + rest}" if rest > 0 else "")
    head = "effect", "outcome", "screened gain", "fit ratio", "held-out ratio", "BIC"
    rows = [_candidate(candidate, each) for candidate in each.candidates[:_SHOWN]]
    return table(title, head, rows, left=2, spare=("screened gain",), file=_FILE)


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


def _parameters(before: FitResult, after: FitResult) -> RenderableType | None:
    """The gear ratio is left out: nothing changes it."""
    was, now = intervals(before), intervals(after)
    units = {p.symbol: p.unit for fit in (before, after) for p in fit.free_parameters.layout.parameters}
    rows = []
    for symbol in dict.fromkeys((*was, *now)):
        if symbol != "N":
            interval = now.get(symbol) or was[symbol]
            status = interval.status if symbol in now else "no longer there"
            status += f" ({interval.remark})" if interval.remark and symbol in now else ""
            rows.append((symbol, *_figures(was.get(symbol)), *_figures(now.get(symbol)), units[symbol],
                         Text(status, style=STATUS_STYLE[interval.status])))  # fmt: skip
    head = "parameter", "before", "95 % interval before", "after", "95 % interval after", "unit", "status"
    return headed("Parameters before and after", filled(head, rows, words=("unit",), prose=("status",),
                  spare=("95 % interval before", "before"), file="RUN/fit.json"))  # fmt: skip


def _figures(i: Interval | None) -> tuple[str, str]:
    if i is None or i.status == "not identifiable":
        return "-", "-"
    digits = Digits.of(i.value, i.spread)
    return digits(i.value), digits.span(i.low, i.high)
