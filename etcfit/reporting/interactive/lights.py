"""How well the model fits a trace, as a traffic light (a colour, a sign and a word), and what to do where it does not.

A trace is judged by the rule of `estimation.goodness`, one held out under the filter of the final model too: its free
run is off wherever an edge of the input fell between two samples, however right the model. Of a model too far from the
data to whiten the residual is the free-run error over the sensors' noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...diagnosis.findings import Diagnosis, RigMistake
from ...estimation.agreement import in_words
from ...estimation.goodness import Goodness, Left, goodness_of, worst
from ...estimation.result import FitResult
from ...problem.prediction_error import columns
from ...problem.trace import Trace
from ...rig.base import ALLOWED_FOR, Finding
from ..pictures import all_traces

_COLOUR = {Left.FITS: "green", Left.STRAYS: "yellow", Left.MORE: "yellow", Left.FAR: "red"}
_WORD = {
    Left.FITS: "fits: nothing but noise is left",
    Left.STRAYS: "fits from sample to sample, but its free run strays",
    Left.MORE: "nearly: more than noise is left",
    Left.FAR: "far off",
}


@dataclass(frozen=True)
class Light:
    """The verdict on one trace."""

    channels: tuple[Goodness, ...]

    @property
    def left(self) -> Left:
        """What the worst of its channels is."""
        return worst(self.channels).left

    @property
    def colour(self) -> str:
        """ "green", "yellow" or "red"."""
        return _COLOUR[self.left]

    @property
    def word(self) -> str:
        """The verdict in words."""
        return _WORD[self.left]

    @property
    def off(self) -> float:
        """How far its worst channel is off, in times the noise."""
        return worst(self.channels).off

    @property
    def says(self) -> list[str]:
        """A sentence on each channel that does not fit."""
        return [each.says for each in self.channels if each.says]

    @property
    def found(self) -> bool:
        """True where something is to be mended."""
        return self.left is not Left.FITS


def lights(result: FitResult) -> list[Light]:
    """One a trace, those fitted first, then those held out."""
    every, score = all_traces(result), (*result.score_fit, *result.score_holdout)
    return [
        Light(goodness_of([trace], [r], score, result.settings))
        for trace, r in zip(every, residuals(result), strict=True)
    ]


def residuals(result: FitResult) -> Sequence[np.ndarray]:
    """r of each trace, those fitted first, then those held out; shape (n, M) each."""
    fitted, holdout = list(result.whitened), result.holdout
    if holdout is None:
        return fitted
    if result.far:
        return [*fitted, *((trace.data - np.asarray(result.predicted[trace.measurement.file])) / np.asarray(trace.sigma)
                           for trace in holdout.batch.traces)]  # fmt: skip
    r = holdout.residual(result.x, holdout.weighted(holdout.kalman(result.x)))
    return [*fitted, *columns(holdout.batch, r)]


_ASK = "What the model may lack has not been looked for: run `etcfit diagnose RUN`."
_EDGES = (
    "Log what drives the throttle faster, or in step with the output that switches it: then each edge has its instant."
)
_NOBODY = "Nothing found names this trace. `etcfit check --advise FOLDER --at RUN` says which further trace would tell."


def cures(trace: Trace, light: Light, final: FitResult, diagnosis: Diagnosis | None) -> list[str]:
    """Sentences, the most specific first; none for a trace in which nothing but noise is left."""
    if not light.found:
        return []
    if light.left is Left.STRAYS:
        return [_EDGES]
    unit = {p.symbol: p.unit for p in final.free_parameters.layout.parameters}
    said = list(_of_the_rig(trace, final, diagnosis))
    said += [in_words(c, unit[c.parameter]) for c in final.contradictions if c.test == trace.test.name]
    said += [warning for warning in final.warnings if trace.measurement.file in warning]
    said += [_ASK] if diagnosis is None else list(_of_the_model(trace, diagnosis))
    return list(dict.fromkeys(said)) or [_NOBODY]


def _of_the_rig(trace: Trace, final: FitResult, diagnosis: Diagnosis | None) -> Iterator[str]:
    """Mistakes of the rig in this trace, each with the line of rig.toml that mends it or with what would tell."""
    mistakes: Sequence[Any] = (*(diagnosis.rig if diagnosis is not None else ()), *final.rig.findings)
    for each in mistakes:
        if each.kind not in ALLOWED_FOR and _lies_in(each, trace):
            if isinstance(each, Finding):
                yield f"{each.kind.replace('_', ' ')}: {each.found} Mend: {each.mend}"
            else:
                yield each.sentence


def _lies_in(mistake: RigMistake | Finding, trace: Trace) -> bool:
    if mistake.file is not None:
        return mistake.file == trace.measurement.file
    return mistake.test is None or mistake.test == trace.test.name


def _of_the_model(trace: Trace, diagnosis: Diagnosis) -> Iterator[str]:
    """What the residual of this trace correlates with, the unnamed rest, and which measurements separate ties."""
    last = diagnosis.rounds[-1].evidence if diagnosis.rounds else None
    for row in last.rows if last is not None else ():
        if row.file == trace.measurement.file and not row.white:
            yield f"The residual of {row.channel.replace('_', ' ')} correlates with {row.strongest}."
    if diagnosis.unexplained is not None:
        yield diagnosis.unexplained.sentence
    for tie in diagnosis.ties:
        names = " and ".join(name.replace("_", " ") for name in tie.effects)
        yield f"{names} cannot be told apart here. What would: {tie.told_by}."
