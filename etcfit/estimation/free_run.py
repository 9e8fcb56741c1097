"""The fit of a model that is far from its data: least squares of the free run, searched for and led to."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..problem import weights
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .global_search import evolve
from .guide import let_go
from .levenberg_marquardt import minimise
from .result import Termination
from .rounds import Reached, Report, searched
from .settings import FitSettings


def fitted_free_running(
    problem: EstimationProblem, x: np.ndarray, report: Report, settings: FitSettings, led: bool = False
) -> Reached:
    """Least squares of the free-running simulation, for a model far from the data.

    What such a model lacks is larger than all that the whitening knows of, so the whitening would only let it follow
    the data; and there a fit may be trapped, so it is searched for as well as descended to. Each channel of each trace
    is weighed by the error that is left in it: what the model cannot explain must not spoil what it can.

    Args:
        problem: the traces.
        x: coordinates to start from, shape (P,).
        report: progress.
        settings: budgets.
        led: a guide led to x already, so none is tried again.
    """
    for k in range(settings.reweighings):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        problem, weighted, x, now = freed(problem, x, settings.spread / 2.0**k, settings, guided=not led)
        led = led or now  # from its own valley the guide leads back to it
    reached = searched(Reached(problem, weighted, x, Termination(False, "")), report, settings)
    return reached._replace(end=replace(reached.end, far=True))


class FreeRun(NamedTuple):
    """The best free-running simulation that was found.

    Args:
        problem: the data, each channel of each trace weighed by the error left in it.
        weighted: what the residual was minimised over.
        x: coordinates, shape (P,).
        led: a guide led there.
    """

    problem: EstimationProblem
    weighted: WeightedData
    x: np.ndarray
    led: bool


def freed(
    problem: EstimationProblem,
    x: np.ndarray,
    spread: float,
    settings: FitSettings = FitSettings(),
    guided: bool = True,
) -> FreeRun:
    """The best free run about x: weighed by the error left in each channel, searched for, descended to, and the one
    to which a guide leads from there, where that is likelier.

    Args:
        problem: the traces.
        x: coordinates, shape (P,).
        spread: of the points searched, in units of each coordinate's reach.
        settings: budgets of search and descent.
        guided: whether a guide is tried.
    """
    problem = weights.discounted(problem, x)
    weighted = problem.weighted(weights.free_running(problem))
    x = evolve(problem, x, weighted, spread * problem.layout.reach(x), settings.search)
    x, _ = minimise(problem, x, weighted, settings.tolerance, settings.steps)
    end = let_go(problem, x, settings) if guided else x
    if end is x:
        return FreeRun(problem, weighted, x, led=False)
    problem = weights.discounted(problem, end)
    return FreeRun(problem, problem.weighted(weights.free_running(problem)), end, led=True)
