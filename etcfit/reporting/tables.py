"""What a fit prints: rich renderables, drawn by whoever has a console."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.explained import explained, motion_explained, share_of
from ..estimation.identifiability import listed
from ..estimation.identifiability import sentences as directions_in_words
from ..estimation.intervals import LUMPS, intervals, lumped
from ..estimation.joint_fit import FitResult
from ..model.effects import PAPER
from ..problem.prediction_error import PredictionError
from ..rig.base import Measurement
from ..run_folder.fit import GEAR_RATIO, budget_of, readings_of
from .blocks import filled, headed, outcome, rig_title, sentences, spaced, stacked, table
from .numbers import Digits, short
from .pool import Pool, grouped

_FILE = "RUN/fit.json"
STATUS_STYLE = {
    "estimated": "",
    "fixed": "dim",
    "tied": "dim",
    "not identifiable": "bold red",
    "compromise": "bold red",
}


def fit_table(result: FitResult) -> RenderableType:
    """A fit for stdout: parameters, score, what is not identifiable, starts and warnings."""
    ended = outcome(result.converged, ("Converged", "NOT CONVERGED"),
                    f"{result.reason}; chi2/dof {short(result.chi2_per_dof, 4)}")  # fmt: skip
    said = motion_explained(result.score_fit, result.score_holdout, result.rig.measurements)
    return stacked(
        _parameters(result),
        _score("Free-running error, fitted traces", result.score_fit, result.rig.measurements),
        _score("Free-running error, held-out traces", result.score_holdout, result.rig.measurements),
        sentences(
            "What these data do not determine, or only roughly",
            directions_in_words(result.identifiability.directions, result.problem.batch.traces),
        ),
        influence_table(result),
        budget_table(result),
        table(
            "Starts of the search: sum of squared residuals, each divided by its noise, before and after",
            ("start", "before", "after", "steps"),
            [(s.name, short(s.chi2_before, 4), short(s.chi2_after, 4), str(s.steps)) for s in result.starts],
            spare=("steps",),
            file=_FILE,
        ),
        spaced(Group(ended, Text(said)) if said else ended),
        sentences("Warnings", result.warnings),
    )


def _parameters(result: FitResult) -> RenderableType:
    layout, read = result.free_parameters.layout, readings_of(result)
    declared = {p.symbol: (p.meaning, p.unit) for p in layout.parameters}
    declared |= {"N": (GEAR_RATIO.partition(",")[0], "1")} | {s: (lump.meaning, lump.unit) for s, lump in LUMPS.items()}
    rows = []
    for symbol, i in (intervals(result) | lumped(result)).items():
        (meaning, unit), digits = declared[symbol], Digits.of(i.value, i.spread)
        status = Text(i.status + (f" ({i.remark})" if i.remark else ""), style=STATUS_STYLE[i.status])
        value = "-" if i.status == "not identifiable" else digits(i.value)
        rows.append((symbol, meaning, short(read.get(symbol), 4), value, digits.span(i.low, i.high), unit, status))
    return Group(
        rig_title(result.rig.config, f"{model_words(result)}, {len(result.problem.batch.traces)} traces"),
        filled(("parameter", "meaning", "reading", "fit", "95 % interval", "unit", "status"), rows, left=2,
               words=("unit",), prose=("meaning", "status"), spare=("meaning", "reading"), file=_FILE),
    )  # fmt: skip


def model_words(result: FitResult) -> str:
    """Eqs. 1-2 and what was added."""
    return " + ".join(["Eqs. 1-2", *(t.name for t in result.free_parameters.layout.types if t not in PAPER)])


def _score(title: str, rows: Sequence[PredictionError], measurements: Sequence[Measurement]) -> RenderableType | None:
    """Pooled over the traces of a test: pictures and fit.json tell them apart."""
    cells = []
    for (test, channel, unit), every in sorted(grouped(rows).items()):
        share, pool = share_of(explained(every, measurements), (channel,)), Pool.of(every)
        figures = (
            short(pool.rms),
            short(pool.sigma),
            short(pool.ratio),
            "-" if share is None else short(100.0 * share, 4),
        )
        cells.append((test, channel, str(pool.traces), str(pool.samples), *figures, unit))
    head = "test", "channel", "traces", "samples", "rms", "sigma", "rms/sigma", "explained %", "unit"
    return table(title, head, cells, left=2, words=("unit",), spare=("samples", "traces", "explained %"), file=_FILE)


STATISTICAL_ONLY = "Intervals are statistical only: rig.toml states no [accuracy] of its instruments."
_NAMED_SHARE = 0.01  # least share of the variance that is named


def budget_table(result: FitResult) -> RenderableType | None:
    """One row a parameter, one column a source; or that intervals are statistical only."""
    if result.budget is None:
        return spaced(Text(STATISTICAL_ONLY, style="dim"))
    units = {parameter.symbol: parameter.unit for parameter in result.free_parameters.layout.parameters}
    rows = []
    for symbol, row in budget_of(result).items():
        shares = dict(row["shares"])
        own = shares.pop("statistical")
        largest = sorted(((share, source) for source, share in shares.items() if share > _NAMED_SHARE), reverse=True)
        words = ", ".join(f"{source} {100.0 * share:.0f} %" for share, source in largest)
        rows.append((symbol, short(row["stderr_statistical"]), units[symbol], f"{100.0 * own:.0f}", words))
    return table(
        "Where the uncertainty comes from, as shares of the variance",
        ("parameter", "statistical standard error", "unit", "statistical share, %", "shares of the instruments"), rows,
        words=("unit",), prose=("shares of the instruments",), spare=("statistical standard error",), file=_FILE,
    )  # fmt: skip


_INFLUENCE = "Influence: the parameter that moves most when a test is left out, and by how many standard errors"


def influence_table(result: FitResult) -> RenderableType | None:
    """A row a test, those that pull hardest first; None where there is nothing to compare."""
    pulls, hardest = result.influence.pulls, {}
    for pull in pulls:
        if pull.file is None:
            hardest.setdefault(pull.test, pull)
    rows = []
    for test, whole in hardest.items():  # and the trace that pulls hardest at the same parameter
        one = next((p for p in pulls if p.file and (p.test, p.parameter) == (test, whole.parameter)), None)
        rows.append((test, whole.parameter, f"{whole.pull:+.1f}", *(("", "") if one is None else
                                                                    (one.file, f"{one.pull:+.1f}"))))  # fmt: skip
    made = filled(("test", "parameter", "pull", "worst trace", "its pull"), rows, left=2, words=("worst trace",),
                  paths=("worst trace",), spare=("its pull", "worst trace"), file=_FILE)  # fmt: skip
    alone = [Text(text, style="dim") for text in determined_alone(result)]
    return headed(_INFLUENCE, Group(made, *alone)) if rows else None


def determined_alone(result: FitResult) -> list[str]:
    """A sentence on each test, or file, without which parameters would not be known: nothing checks it on them."""
    by_part: dict[str, list[str]] = {}
    for symbol, part in result.influence.alone.items():
        by_part.setdefault(part, []).append(symbol)
    return [f"Only {part} determines {listed(symbols)}: no other test checks it." for part, symbols in by_part.items()]
