"""What to do about a trace that the model does not fit, in the words that fit and diagnosis already have for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ...diagnosis.findings import Diagnosis, RigMistake
from ...estimation.contradiction import Contradiction
from ...estimation.goodness import Left
from ...estimation.result import FitResult
from ...problem.trace import Trace
from ...rig.base import ALLOWED_FOR, Finding
from ..numbers import short
from .lights import Light

_ASK = "What the model may lack has not been looked for: run `etcfit diagnose RUN`."
_EDGES = (
    "Log what drives the throttle faster, or in step with the output that switches it: then each edge has its instant."
)
_NOBODY = "Nothing found names this trace. `etcfit check --advise FOLDER --at RUN` says which further trace would tell."


def cures(trace: Trace, light: Light, final: FitResult, diagnosis: Diagnosis | None) -> list[str]:
    """Sentences, the most specific first; none for a trace in which nothing but noise is left.

    Args:
        trace: which.
        light: the verdict on it.
        final: the model that the page shows.
        diagnosis: None where none was made.
    """
    if not light.found:
        return []
    if light.left is Left.STRAYS:
        return [_EDGES]
    said = [*_of_the_rig(trace, final, diagnosis), *_contradicted(trace, final.contradictions)]
    said += [warning for warning in final.warnings if trace.measurement.file in warning]
    said += [_ASK] if diagnosis is None else list(_of_the_model(trace, diagnosis))
    return list(dict.fromkeys(said)) or [_NOBODY]


def _of_the_rig(trace: Trace, final: FitResult, diagnosis: Diagnosis | None) -> Iterator[str]:
    """Mistakes of the rig in this trace, each with the line of rig.toml that mends it or with what would tell."""
    mistakes: Sequence[Any] = (*(diagnosis.rig if diagnosis is not None else ()), *final.rig.findings)
    for each in mistakes:
        if each.kind not in ALLOWED_FOR and _lies_in(each, trace):
            yield (
                each.sentence
                if isinstance(each, RigMistake)
                else f"{each.kind.replace('_', ' ')}: {each.found} Mend: {each.mend}"
            )


def _lies_in(mistake: RigMistake | Finding, trace: Trace) -> bool:
    if mistake.file is not None:
        return mistake.file == trace.measurement.file
    return mistake.test is None or mistake.test == trace.test.name


def _contradicted(trace: Trace, contradictions: Sequence[Contradiction]) -> Iterator[str]:
    for each in contradictions:
        if each.test == trace.test.name:
            yield (
                f"{each.test.replace('_', ' ')} contradicts the other tests: without it {each.parameter} is "
                f"{short(each.without)} instead of {short(each.value)}. Look at that test's circuit, gear and clock."
            )


def _of_the_model(trace: Trace, diagnosis: Diagnosis) -> Iterator[str]:
    """What the residual of this trace goes along with, what was left without a name, and what would tell ties apart."""
    last = diagnosis.rounds[-1].evidence if diagnosis.rounds else None
    for row in last.rows if last is not None else ():
        if row.file == trace.measurement.file and not row.white:
            yield f"What is left in {row.channel.replace('_', ' ')} goes along with {row.strongest}."
    if diagnosis.unexplained is not None:
        yield diagnosis.unexplained.sentence
    for tie in diagnosis.ties:
        names = " and ".join(name.replace("_", " ") for name in tie.effects)
        yield f"{names} cannot be told apart here. What would: {tie.told_by}."
