"""The rounds of a fit: the whitening filter and the least squares through it, renewed in turn until neither moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..problem import weights
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .global_search import settle
from .levenberg_marquardt import descend, local, minimise
from .result import Reason, Termination
from .settings import FitSettings

Report = Callable[[str, float], None]  # called with what is going on and the share of the work done, 0 to 1


def quiet(text: str, share: float) -> None:
    """A progress report that says nothing."""


class Reached(NamedTuple):
    """Where a part of the fit ended.

    Args:
        problem: the data with releases, integrator states, jitter and outliers as last renewed.
        weighted: what the residual was minimised over.
        x: coordinates, shape (P,).
        end: why it ended.
    """

    problem: EstimationProblem
    weighted: WeightedData
    x: np.ndarray
    end: Termination

    @property
    def misfit(self) -> float:
        """chi2 per sample."""
        return self.problem.chi2(self.x, self.weighted) / max(1.0, self.weighted.samples)


def whitened(
    problem: EstimationProblem, x: np.ndarray, report: Report, settings: FitSettings = FitSettings()
) -> Reached:
    """The rounds, and a search from where they end short of an optimum."""
    return finished(rounds(problem, x, report, settings.settled, settings.rounds, settings), report, settings)


def finished(reached: Reached, report: Report, settings: FitSettings) -> Reached:
    """The end of the rounds, or of a search from there where they ended short of an optimum."""
    return searched(reached, report, settings) if reached.end.gain > settings.decrement else reached


def rounds(
    problem: EstimationProblem,
    x: np.ndarray,
    report: Report,
    still: float,
    most: int,
    settings: FitSettings = FitSettings(),
) -> Reached:
    """Renew the whitening filter, the releases and the outliers at each optimum until nothing moves any more.

    Args:
        problem: the traces.
        x: coordinates near an optimum, shape (P,).
        report: progress.
        still: what counts as not moving, standard errors.
        most: rounds.
        settings: thresholds of the verdict, tolerance and budget of each descent.
    """
    moved, outliers, about = np.inf, 0, x
    k = 0
    while True:
        report(f"whitening {k + 1}: moved {moved:.2g} standard errors", 0.5 + 0.4 * k / most)
        weighted = problem.weighted(problem.kalman(about))
        down = descend if k < settings.off_bound_rounds else minimise
        x, _ = down(problem, x, weighted, settings.tolerance, settings.steps)
        here = local(problem, x, weighted)
        moved = float(np.max(np.abs(x - about) / np.sqrt(np.diag(here.covariance))))
        if (moved < still and k > 0) or k == most - 1:
            end = after_rounds(moved, here.gain, outliers, settings)
            return Reached(problem, weighted, x, replace(end, wander=(x - about)[None], gain=here.gain))
        # later rounds linearise half way: an impact that crosses a sampling instant makes two optima alternate
        early = k < settings.clock_rounds
        about = x if early else 0.5 * (about + x)
        r = problem.residual(x, weighted)
        whitened = columns(problem.batch, r)
        del weighted  # the largest arrays of a fit, before the next ones are made
        problem = weights.timed(problem, x, r) if early else problem
        problem = problem.with_instants(about)
        problem, outliers = weights.outliers_weighed(problem, whitened)
        k += 1


def after_rounds(moved: float, gain: float, outliers: int = 0, settings: FitSettings = FitSettings()) -> Termination:
    """Whether the end of the rounds is an optimum.

    Args:
        moved: by how much the last round moved the parameter that it moved most, standard errors.
        gain: chi2 that the gradient still promises, in units of chi2 per degree of freedom.
        outliers: samples weighed down.
        settings: `wandering` and `alternating`, the limits of `moved`.
    """
    if not np.isfinite(gain):
        text = "the model cannot be computed at the point reached"
        return Termination(False, text, outliers, reason_code=Reason.NOT_COMPUTABLE)
    if moved > settings.wandering:
        text = f"the last round still moved a parameter by {moved:.2g} standard errors"
        return Termination(False, text, outliers, reason_code=Reason.WANDERING)
    still = f"gradient zero to {gain:.1e} of chi2"
    if moved > settings.alternating:
        text = f"{still}; the rounds alternate by {moved:.2g} standard errors, which the intervals include"
        return Termination(True, text, outliers, reason_code=Reason.ALTERNATING)
    text = f"{still}, last round moved {moved:.2g} standard errors"
    return Termination(True, text, outliers, reason_code=Reason.OPTIMUM)


def after_search(gain: float, outliers: int = 0, settings: FitSettings = FitSettings()) -> Termination:
    """Whether the end of a search without a gradient is an optimum.

    Args:
        gain: chi2 that the last points drawn still gained, in units of chi2 per degree of freedom.
        outliers: samples weighed down.
        settings: `rough`, the limit of `gain`.
    """
    if gain > settings.rough:
        text = f"points about the end still lower chi2, by {gain:.2g} of its own size per sample"
        return Termination(False, text, outliers, reason_code=Reason.ROUGH)
    text = f"chi2 is too rough for its gradient; no point drawn within a standard error lowers it by {settings.rough}"
    return Termination(True, text, outliers, reason_code=Reason.SEARCHED)


def searched(reached: Reached, report: Report, settings: FitSettings) -> Reached:
    """Go on without a gradient from where it leads no further."""
    problem, weighted, x, end = reached
    here = local(problem, x, weighted)
    report("the gradient does not vanish: searching without it", 0.9)
    x, gain = settle(problem, x, weighted, here.covariance, here.unit, settings.search)
    return Reached(problem, weighted, x, after_search(gain, end.outliers, settings))
