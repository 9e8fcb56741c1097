"""How well the model fits a trace, as a traffic light: a colour, a sign and a word, never a colour alone.

A trace is judged by the rule of `estimation.goodness`, one held out under the filter of the final model too: its free
run is off wherever an edge of the input fell between two samples, however right the model. Of a model too far from the
data to whiten the residual is the free-run error over the sensors' noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...estimation.goodness import Goodness, Left, goodness_of, worst
from ...estimation.result import FitResult
from ...problem.prediction_error import columns
from ...problem.trace import Trace
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
    """The verdict on one trace.

    Args:
        channels: what is left in each.
    """

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
        return [*fitted, *(_in_sigma(result, trace) for trace in holdout.batch.traces)]
    r = holdout.residual(result.x, holdout.weighted(holdout.kalman(result.x)))
    return [*fitted, *columns(holdout.batch, r)]


def _in_sigma(result: FitResult, trace: Trace) -> np.ndarray:
    return (trace.data - np.asarray(result.predicted[trace.measurement.file])) / np.asarray(trace.sigma)
