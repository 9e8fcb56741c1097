"""How well the model fits a trace, as a traffic light: a colour, a sign and a word, never a colour alone.

A fitted trace is judged by its whitened residual, one held out by its free-run error over its sensors' noise,

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


def light(result: FitResult, trace: Trace, k: int) -> Light:
    """Of one trace under a model.

    Args:
        result: the model and its residuals.
        trace: which.
        k: its number among the fitted traces, then those held out.
    """
    fitted = k < len(result.whitened)
    error = (trace.data - np.asarray(result.predicted[trace.measurement.file])) / np.asarray(trace.sigma)
    r = np.asarray(result.whitened[k]) if fitted else error
    r = r[np.isfinite(trace.data)]
    judged_by = "whitened residual" if fitted and not result.far else "free-run error over the sensors' noise"
    if not r.size or not np.all(np.isfinite(r)):
        return Light("red", None, judged_by)
    chi2 = float(np.mean(r**2))
    return Light(_colour(chi2, r.size), chi2, judged_by)


def _colour(chi2: float, n: int) -> str:
    if chi2 <= NOISE + _DEVIATIONS * np.sqrt(2.0 / n):
        return "green"
    return "yellow" if chi2 < FAR else "red"
