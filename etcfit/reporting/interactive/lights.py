"""How well the model fits a trace, as a traffic light: a colour, a sign and a word, never a colour alone.

A trace is judged by its whitened residual r, one held out under the filter of the final model too: its free run is off
wherever an edge of the input fell between two samples, however right the model. Of a model too far from the data to
whiten r is the free-run error over the sensors' noise.

    m = sum r^2 / n,    green where m <= 1.2 + 3 sqrt(2/n),    yellow where m < 2,    red beyond

with the limit by which the page's verdict judges the whole (1.2), that from which a fit calls its parameters a
compromise (`ContradictionSettings.compromise`), and three standard deviations of what n samples of mere noise
scatter by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...estimation.result import FitResult
from ...estimation.settings import ContradictionSettings
from ...problem.prediction_error import columns
from ...problem.trace import Trace
from ..page.verdict import NOISE

FAR = ContradictionSettings().compromise  # as for the whole
_DEVIATIONS = 3.0  # by which noise alone may exceed the limit


@dataclass(frozen=True)
class Light:
    """The verdict on one trace.

    Args:
        colour: "green", "yellow" or "red".
        chi2: m above; None where the model could not be simulated.
        judged_by: what it is of, in words.
    """

    colour: str
    chi2: float | None
    judged_by: str

    @property
    def found(self) -> bool:
        """True where something is to be mended."""
        return self.colour != "green"


def residuals(result: FitResult) -> list[np.ndarray]:
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


def light(result: FitResult, trace: Trace, r: np.ndarray) -> Light:
    """Of one trace under a model.

    Args:
        result: the model.
        trace: which.
        r: of that trace, see `residuals`, shape (n, M).
    """
    r = np.asarray(r)[np.isfinite(trace.data)]
    judged_by = "free-run error over the sensors' noise" if result.far else "whitened residual"
    if not r.size or not np.all(np.isfinite(r)):
        return Light("red", None, judged_by)
    chi2 = float(np.mean(r**2))
    return Light(_colour(chi2, r.size), chi2, judged_by)


def _colour(chi2: float, n: int) -> str:
    if chi2 <= NOISE + _DEVIATIONS * np.sqrt(2.0 / n):
        return "green"
    return "yellow" if chi2 < FAR else "red"
