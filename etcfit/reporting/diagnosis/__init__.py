"""What a person sees of a diagnosis: what `etcfit diagnose` prints."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from ...diagnosis.findings import Candidate, Diagnosis, RoundReport, Statement
from ...diagnosis.probabilities import CALIBRATED, likely_in_one_line
from ...estimation.intervals import Interval, intervals
from ...estimation.joint_fit import FitResult
from ..blocks import PlainTable, all_shown, headed, outcome, rig_title, sentences, shown, spaced, stacked
from ..numbers import Digits, short
from ..pool import errors_table
from ..table import Column, Kind, Table, of_texts
from ..tables import LOST, status_cell
from .ledger import ledger

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
        shown(errors_table(ledger(diagnosis), True, _FILE)),
        sentences("What no effect explains", _unexplained(diagnosis)),
        sentences("Effects that these data cannot tell apart", ties),
        _rounds(diagnosis.rounds),
        all_shown(*(_candidates(k, each) for k, each in enumerate(diagnosis.rounds, start=1))),
        sentences("Looking back", [*diagnosis.removed, *sets]),
        _parameters(diagnosis.before, after),
        spaced(outcome(after.converged, ended, f"{after.reason}; chi2/dof {short(after.chi2_per_dof, 4)}")),
        sentences("Warnings", after.warnings),
    )


def _how_sure(diagnosis: Diagnosis) -> RenderableType | None:
    """Each effect found, how sure it is, and what else could explain the same; then what is left at the end."""
    if not diagnosis.questions:
        return None
    at_last = diagnosis.questions[-1]
    parts: list[RenderableType] = [PlainTable(_stated(diagnosis.statements))] if diagnosis.statements else []
    parts += [Text(f"{at_last.asks} {likely_in_one_line(at_last.answers)}."), Text(CALIBRATED, style="dim")]
    return headed("How sure", Group(*parts))


def _stated(statements: Sequence[Statement]) -> Table:
    rows = [(each.effect, each.certainty, f"{each.probability:.2f}",
             likely_in_one_line(each.instead) or "nothing that was tried", each.told_by)
            for each in statements]  # fmt: skip
    prose: dict[str, Kind] = {"what else could be": "prose", "what would tell": "prose"}
    return of_texts("How sure", ("effect", "how sure", "probability", *prose), rows, 2, prose, file=_FILE)


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


def _candidates(k: int, each: RoundReport) -> Table:
    rest = len(each.candidates) - _SHOWN
    title = f"Round {k}, candidates" + (f", the first {_SHOWN} of {_SHOWN + rest}" if rest > 0 else "")
    head = "effect", "outcome", "screened gain", "fit ratio", "held-out ratio", "BIC"
    rows = [_candidate(candidate, each) for candidate in each.candidates[:_SHOWN]]
    return of_texts(title, head, rows, 2, spare=("screened gain",), file=_FILE)


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
    return shown(Table("Parameters before and after", columns, rows, file="RUN/fit.json"))


def _figures(i: Interval | None) -> tuple[str, str]:
    if i is None or i.status == LOST:
        return "-", "-"
    digits = Digits.of_value(i.value, i.spread)
    return digits(i.value), digits.span(i.low, i.high)
