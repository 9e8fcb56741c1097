"""Which test pulls which parameter, for stdout: the largest pull of every test, and what one test alone tells."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ..estimation.agreement import Pull
from ..estimation.identifiability import listed
from ..estimation.result import FitResult
from .blocks import headed, plain_table

_TITLE = "Influence: the parameter that moves most when a test is left out, and by how many standard errors"


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
    return headed(_TITLE, Group(table, *alone))


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
