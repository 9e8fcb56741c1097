"""Optima that lie side by side, and which of them is meant.

Under an ECU a tick, a slip or a jump of the setpoint falls on either side of a sample, and the rounds of whitening end
in one of several optima: in that near which they began. They are begun again from that end and from points about it.
Of all ends that one is kept which makes the data likeliest, by

    -2 log L = sum_k (r_k^2 + log S_k) + r_prior^2

for chi2 alone compares no two filters: one that expects large errors finds every error small. How far the others lie
away, each weighed by its likelihood, belongs to the parameters' covariance:

    C + sum_k w_k d_k d_k^T,    w_k = L_k / sum_j L_j

Source: Kass and Raftery 1995, Bayes factors, sec. 4 (a mixture of modes). Differs from source: modes are taken to be
equally wide, for a mode's width is what its rough surroundings tell worst.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..problem.chi2 import chi2_of
from ..problem.program import concurrently
from .levenberg_marquardt import local
from .rounds import Reached, Report, finished, quiet, rounds
from .settings import FitSettings


def deviance(reached: Reached) -> float:
    """-2 log L of the data at an end, up to a constant; infinite where the model cannot be computed there."""
    problem, weighted, x, _ = reached
    seen = np.asarray(weighted.slots.weight) > 0.0
    precision = np.asarray(weighted.whitening.weight)[seen]
    return float(chi2_of(problem, x[None], weighted)[0] - 2.0 * np.sum(np.log(precision)))


def deepest_nearby(reached: Reached, report: Report, settings: FitSettings = FitSettings()) -> Reached:
    """The likeliest of an end and of those nearby, with the others beside it in `Termination.wander`.

    Args:
        reached: end of the rounds.
        report: progress.
        settings: `neighbours`, `neighbourhood`, `within`, and those of the rounds.
    """
    if not settings.neighbours:
        return reached
    report("looking for likelier optima nearby", 0.9)

    def again(x: np.ndarray) -> Reached:
        return rounds(reached.problem.with_instants(x), x, quiet, settings.settled, settings.rounds, settings)

    ends = [reached, *concurrently(again, [reached.x, *_points_about(reached, settings)])]
    every = np.array([deviance(end) for end in ends])
    best = finished(ends[int(np.argmin(every))], quiet, settings)
    return _beside(best, ends, every)


def _points_about(reached: Reached, settings: FitSettings) -> Iterator[Float[np.ndarray, " P"]]:
    """Points beside the end where the rounds begin again, inside what the model can compute."""
    problem, weighted, x, _ = reached
    reach = problem.layout.reach(x)
    scaled = local(problem, x, weighted).covariance / np.outer(reach, reach)
    values, vectors = np.linalg.eigh(scaled)
    step = vectors * np.clip(np.sqrt(np.maximum(values, 0.0)), 0.0, settings.within)
    rng = np.random.default_rng(settings.seed)
    for k in range(settings.neighbours):
        far = settings.neighbourhood[k % len(settings.neighbourhood)]
        point = x + far * reach * (step @ rng.standard_normal(x.size))
        if np.isfinite(problem.chi2(point, weighted)):
            yield point


def _beside(best: Reached, ends: list[Reached], every: Float[np.ndarray, " K"]) -> Reached:
    """The best end with how far the others lie away from it, each by the root of its weight."""
    weight = np.exp(0.5 * (every.min() - every))
    weight /= weight.sum()
    away = np.sqrt(weight)[:, None] * np.array([end.x - best.x for end in ends])
    own = best.end.wander if best.end.wander is not None else np.zeros((1, best.x.size))
    return best._replace(end=replace(best.end, wander=np.concatenate((own, away))))
