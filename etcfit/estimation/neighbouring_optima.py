"""Optima beside the one that was found, and which of them is meant.

Under an ECU a plate that sticks at one tick or the next, turns a little earlier or holds where it slipped makes other
valleys of the sum of squares, a few percent of a parameter apart and as deep as the data's noise allows. The fit is
begun again from points about its end, with all instants forgiven at first; about a likelier end once more; and where it
ended in a valley that does not explain the data, from points about its start. Of all ends that one is kept which makes
the data likeliest, by

    -2 log L = sum_k (r_k^2 + log S_k) + r_prior^2

for chi2 alone compares no two filters: one that expects large errors finds every error small. How far the others lie
away, each weighed by its likelihood, belongs to the parameters' covariance:

    C + sum_k w_k d_k d_k^T,    w_k = L_k / sum_j L_j

Source: Wales and Doye 1997, Global optimization by basin-hopping; Kass and Raftery 1995, Bayes factors, sec. 4 (a
mixture of modes). Differs from source: points are drawn about the likeliest end only, several at a time; modes are
taken to be equally wide, for a mode's width is what its rough surroundings tell worst.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..problem.chi2 import chi2_of
from ..problem.cores import concurrently
from ..problem.problem import EstimationProblem
from .approach import approach, with_lag_of
from .rounds import Reached, Report, finished, quiet, rounds
from .settings import FitSettings


class _End(NamedTuple):
    """Where the fit ended, and -2 log L there."""

    reached: Reached
    deviance: float


def deviance(reached: Reached) -> float:
    """-2 log L of the data at an end, up to a constant; infinite where the model cannot be computed there."""
    problem, weighted, x, _ = reached
    seen = np.asarray(weighted.slots.weight) > 0.0
    precision = np.asarray(weighted.whitening.weight)[seen]
    found = float(chi2_of(problem, x[None], weighted)[0] - 2.0 * np.sum(np.log(precision)))
    return found if np.isfinite(found) else np.inf


def likeliest_nearby(
    reached: Reached, start: Float[np.ndarray, " P"], report: Report, settings: FitSettings = FitSettings()
) -> Reached:
    """The likeliest of an end and of those nearby, with the others beside it in `Termination.wander`.

    Args:
        reached: end of the rounds.
        start: coordinates with which the fit began.
        report: progress.
        settings: `neighbours` to `likelier`, and those of approach and rounds.
    """
    best = _End(reached, deviance(reached))
    if not settings.neighbours or not np.isfinite(best.deviance):
        return reached
    rng = np.random.default_rng(settings.seed)
    ends = [best]
    for k in range(settings.searches):
        report(f"looking for likelier optima nearby, {k + 1} of at most {settings.searches}", 0.9)
        ends += _ends_from(_points(best, start, rng, settings), best, start, settings)
        before, best = best.deviance, min(ends, key=lambda end: end.deviance)
        if before - best.deviance < settings.likelier and best.reached.misfit < settings.explained:
            break
    return _beside(finished(best.reached, quiet, settings), ends)


def _points(best: _End, start: np.ndarray, rng: np.random.Generator, settings: FitSettings) -> list[np.ndarray]:
    """Points about an end that explains the data; where it does not, about the start."""
    layout, explained = best.reached.problem.layout, best.reached.misfit < settings.explained
    about, spreads = (best.reached.x, settings.neighbourhood) if explained else (start, (settings.spread,))
    far = [spreads[k % len(spreads)] for k in range(settings.neighbours)]
    return [layout.off_bounds(about + each * layout.reach(about) * rng.standard_normal(about.size)) for each in far]


def _ends_from(points: list[np.ndarray], best: _End, start: np.ndarray, settings: FitSettings) -> list[_End]:
    """Where the fit leads from some points; from some only in a few rounds, which come nowhere near the likeliest."""
    problem = best.reached.problem

    def first(point: np.ndarray) -> _End:
        point, _ = approach(problem, point, settings.rough_tolerance, settings)
        point = with_lag_of(start, problem, point)
        return _whitened(problem.with_instants(point), point, settings.first_rounds, settings)

    found = concurrently(first, points)
    least = min(end.deviance for end in (best, *found)) + settings.hopeful
    return concurrently(lambda end: _further(end, settings) if end.deviance < least else end, found)


def _further(end: _End, settings: FitSettings) -> _End:
    """The rest of the rounds; the end itself where they lead to none that is likelier."""
    later = _whitened(end.reached.problem, end.reached.x, max(1, settings.rounds - settings.first_rounds), settings)
    return min(end, later, key=lambda end: end.deviance)


def _whitened(problem: EstimationProblem, x: np.ndarray, most: int, settings: FitSettings) -> _End:
    reached = rounds(problem, x, quiet, settings.nearly_settled, most, settings)
    return _End(reached, deviance(reached))


def _beside(best: Reached, ends: list[_End]) -> Reached:
    """The best end with how far the others lie away from it, each by the root of its weight."""
    every = np.array([end.deviance for end in ends])
    weight = np.exp(0.5 * (every.min() - every))
    weight /= weight.sum()
    kept = weight > 0.0
    away = np.sqrt(weight[kept])[:, None] * np.array([end.reached.x - best.x for end in ends])[kept]
    own = best.end.wander if best.end.wander is not None else np.zeros((1, best.x.size))
    return best._replace(end=replace(best.end, wander=np.concatenate((own, away))))
