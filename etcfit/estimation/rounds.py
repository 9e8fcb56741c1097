"""The rounds of whitening and least squares, and the searches about their end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..problem import weights
from ..problem.chi2 import chi2_of
from ..problem.cores import concurrently
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .levenberg_marquardt import (
    ROUGH_TOLERANCE,
    LinearisedProblem,
    descend,
    descend_in_stages,
    linearise_at,
    minimise,
    with_lag_of_start,
)
from .result import Reason, Termination
from .settings import FitSettings, GlobalSearchSettings

# ---- The rounds of a fit: the whitening filter and the least squares, renewed in turn until neither changes


SETTLED = 0.05  # a round that moves no parameter by more is the last, standard errors
CLOCK_ROUNDS = 4
"""Number of first rounds, which also estimate the jitter of the sampling instants. Later rounds linearise half way
between the last optimum and the likeliest place so far: an impact or a slip that crosses a sampling instant would
otherwise make optima alternate. Where the rounds do not settle, that place is their end if it is the likelier."""
OFF_BOUND_ROUNDS = 2  # number of first rounds whose descents begin away from the bounds of the parameters
ALTERNATING = 1.0  # a last round that moves a parameter by more is reported to alternate, standard errors
WANDERING = 10.0  # a last round that moves one by more is no optimum: the fit has not converged, standard errors
DECREMENT = 1e-2
"""Predicted fall of chi2 by the gradient, in units of chi2 per degree of freedom, above which a search looks for a
deeper end about the end of the rounds."""
ROUGH = 0.1
"""Largest fall of chi2, in the same units, by the last draws of such a search for which the fit counts as converged."""

Report = Callable[[str, float], None]  # called with the current step and the share of the work done, 0 to 1


def quiet(text: str, share: float) -> None:
    """A progress report that prints nothing."""


class Reached(NamedTuple):
    """The end of a part of the fit."""

    problem: EstimationProblem  # the data with the last releases, integrator states, jitter and outliers
    weighted: WeightedData  # the weighted data of the minimised residual
    x: np.ndarray  # coordinates, shape (P,)
    end: Termination  # why it ended

    @property
    def misfit(self) -> float:
        """chi2 per sample."""
        return self.problem.chi2(self.x, self.weighted) / max(1.0, self.weighted.samples)

    @property
    def deviance(self) -> float:
        """-2 log L of the data, see `deviance`."""
        return deviance(self.problem, self.weighted, self.x)


def deviance(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray) -> float:
    """-2 log L of the data at coordinates x, shape (P,), up to a constant; infinite if the model cannot be computed.

        -2 log L = sum_k (r_k^2 + log S_k) + r_prior^2

    It compares two filters, which chi2 alone cannot: a filter that expects large errors gives a small chi2.
    """
    seen = np.asarray(weighted.slots.weight) > 0.0
    precision = np.asarray(weighted.whitening.weight)[seen]
    if not np.all(precision > 0.0):
        return np.inf
    found = float(chi2_of(problem, x[None], weighted)[0] - 2.0 * np.sum(np.log(precision)))
    return found if np.isfinite(found) else np.inf


def whitened(
    problem: EstimationProblem, x: np.ndarray, report: Report, settings: FitSettings = FitSettings()
) -> Reached:
    """The rounds, and a search from their end if that is not an optimum."""
    return finished(rounds(problem, x, report, SETTLED, settings.rounds, settings), report, settings)


def finished(reached: Reached, report: Report, settings: FitSettings) -> Reached:
    """The end of the rounds, or of a search from there if that is not an optimum."""
    return searched(reached, report, settings) if reached.end.gain > DECREMENT else reached


def rounds(
    problem: EstimationProblem,
    x: np.ndarray,
    report: Report,
    still: float,
    most: int,
    settings: FitSettings = FitSettings(),
) -> Reached:
    """Renew the whitening filter, the releases and the outliers at each optimum until no parameter moves.

    Args:
        still: largest movement that counts as none, standard errors.
    """
    moved, outliers, about, likeliest = np.inf, 0, x, None
    k = 0
    while True:
        before = f": the last one moved {moved:.2g} standard errors" if k else ""
        report(f"whitening {k + 1}{before}", 0.5 + 0.4 * k / most)
        weighted = problem.weighted(problem.kalman(about))
        unlikely = deviance(problem, weighted, about)
        down = descend if k < OFF_BOUND_ROUNDS else minimise
        x, _ = down(problem, x, weighted, settings.tolerance, settings.steps)
        if likeliest is None or unlikely < likeliest.deviance:
            likeliest = _Round(problem, about, x, outliers, unlikely)
        here = linearise_at(problem, x, weighted)
        moved = _standard_errors(x - about, here)
        if (moved < still and k > 0) or k == most - 1:
            reached = _ended(problem, weighted, x, x - about, here, outliers)
            return reached if moved < ALTERNATING else _likelier(reached, likeliest)
        early = k < CLOCK_ROUNDS
        about = x if early else 0.5 * (likeliest.about + x)
        r = problem.residual(x, weighted)
        whitened = columns(problem.batch, r)
        del weighted  # free the largest arrays of a fit before the next ones are made
        problem = weights.timed(problem, x, r) if early else problem
        problem = problem.with_instants(about)
        problem, outliers = weights.outliers_weighed(problem, whitened)
        k += 1


class _Round(NamedTuple):
    """A round without its largest arrays."""

    problem: EstimationProblem
    about: np.ndarray  # coordinates of its filter, shape (P,)
    x: np.ndarray  # where it led, shape (P,)
    outliers: int
    deviance: float  # -2 log L of the data at `about`


def _likelier(reached: Reached, likeliest: _Round) -> Reached:
    """The end of rounds that did not settle, or the place of the likeliest filter if the data are likelier there."""
    own = reached.problem.weighted(reached.problem.kalman(reached.x))
    if not likeliest.deviance < deviance(reached.problem, own, reached.x):
        return reached
    problem, x, optimum, outliers, _ = likeliest
    weighted = problem.weighted(problem.kalman(x))
    return _ended(problem, weighted, x, optimum - x, linearise_at(problem, x, weighted), outliers)


def _ended(
    problem: EstimationProblem,
    weighted: WeightedData,
    x: np.ndarray,
    wander: np.ndarray,
    here: LinearisedProblem,
    outliers: int,
) -> Reached:
    """The end of rounds at x, where the optimum of a filter and its coordinates are `wander` apart, shape (P,)."""
    end = after_rounds(_standard_errors(wander, here), here.gain, outliers)
    return Reached(problem, weighted, x, replace(end, wander=wander[None], gain=here.gain))


def _standard_errors(step: np.ndarray, here: LinearisedProblem) -> float:
    return float(np.max(np.abs(step) / np.sqrt(np.diag(here.covariance))))


def after_rounds(moved: float, gain: float, outliers: int = 0) -> Termination:
    """Whether the end of the rounds is an optimum.

    Args:
        moved: largest movement of a parameter in the last round, standard errors.
        gain: fall of chi2 that the gradient predicts, in units of chi2 per degree of freedom.
    """
    if not np.isfinite(gain):
        text = "the model cannot be computed at the point reached"
        return Termination(False, text, outliers, reason_code=Reason.NOT_COMPUTABLE)
    if moved > WANDERING:
        text = f"the last round still moved a parameter by {moved:.2g} standard errors"
        return Termination(False, text, outliers, reason_code=Reason.WANDERING)
    still = f"one more step would lower chi2 by {gain:.1e} chi2/dof"
    if moved > ALTERNATING:
        text = f"{still}; the rounds alternate by up to {moved:.2g} standard errors, which the intervals include"
        return Termination(True, text, outliers, reason_code=Reason.ALTERNATING)
    text = f"{still}; the last round moved no parameter by more than {moved:.2g} standard errors"
    return Termination(True, text, outliers, reason_code=Reason.OPTIMUM)


def after_search(gain: float, outliers: int = 0) -> Termination:
    """Whether the end of a search without a gradient is an optimum.

    Args:
        gain: fall of chi2 by the last points drawn, in units of chi2 per degree of freedom.
    """
    if gain > ROUGH:
        text = f"points near the end still lower chi2 by {gain:.2g} chi2/dof"
        return Termination(False, text, outliers, reason_code=Reason.ROUGH)
    text = f"chi2 is too rough for its gradient; no point within a standard error lowers it by {ROUGH} chi2/dof"
    return Termination(True, text, outliers, reason_code=Reason.SEARCHED)


def searched(reached: Reached, report: Report, settings: FitSettings) -> Reached:
    """Continue without a gradient if the gradient leads no further."""
    problem, weighted, x, end = reached
    here = linearise_at(problem, x, weighted)
    report("the gradient does not vanish: searching without it", 0.9)
    x, gain = search_about(
        lambda points: chi2_of(problem, points, weighted), x, here.covariance, here.unit, settings.search
    )
    return Reached(problem, weighted, x, after_search(gain, end.outliers))


# ---- A search that needs no gradient, for a residual that is too rough for one
#
# A model that lacks an effect sticks, slips and hits its stops at other samples than the plate did; its chi2 is then
# full of small steps on which Levenberg-Marquardt stops. Points drawn about where it stopped find a lower chi2, or show
# that there is none nearby.

LEAST_GAIN = 0.01  # least relative fall of chi2 over the patience of the search, else the population stops
WORTH = 0.02  # least fall of chi2 for a move, in units of chi2 per degree of freedom
RADII = (1.0, 0.3, 0.1, 0.03)  # radii at which equal shares of the points are drawn, standard deviations of the fit
Cost = Callable[[np.ndarray], np.ndarray]  # the cost of K points at once, shape (K, P) -> (K,)


def evolve_population(
    cost: Cost, x: np.ndarray, spread: np.ndarray, settings: GlobalSearchSettings = GlobalSearchSettings()
) -> np.ndarray:
    """The best point of a population that begins about x and evolves by differential evolution.

        trial = u + F (best - u) + F (a - b),  or  c + F (a - b),    F ~ U(0.4, 0.9), nine tenths of its coordinates

    A trial replaces u if its cost is lower. Source: Storn and Price 1997, strategies current-to-best/1 and rand/1.
    Differs from source: each trial takes one of the strategies at random, with a new F.

    Args:
        cost: the positive function to minimise.
        x: coordinates, shape (P,); one of the population, so the end is never worse.
        spread: standard deviations of the first population, coordinates, shape (P,).
    Returns:
        Coordinates, shape (P,).
    """
    rng = np.random.default_rng(settings.population_seed)
    size = settings.points
    crowd = x + spread * rng.standard_normal((size, x.size))
    crowd[0] = x
    price = cost(crowd)
    history = [float(price.min())]
    for epoch in range(settings.epochs):
        if epoch >= settings.patience and history[-1] > (1.0 - LEAST_GAIN) * history[-settings.patience]:
            break
        a, b, c = (crowd[rng.permutation(size)] for _ in range(3))
        step = rng.uniform(0.4, 0.9, (size, 1))
        greedy = crowd + step * (crowd[np.argmin(price)] - crowd) + step * (a - b)
        young = np.where(rng.uniform(size=(size, 1)) < 0.5, greedy, c + step * (a - b))
        young = np.where(rng.uniform(size=young.shape) < 0.9, young, crowd)
        young_price = cost(young)
        better = young_price < price
        crowd[better], price[better] = young[better], young_price[better]
        history.append(float(price.min()))
    return crowd[int(np.argmin(price))]


def search_about(
    cost: Cost,
    x: np.ndarray,
    covariance: np.ndarray,
    unit: float,
    settings: GlobalSearchSettings = GlobalSearchSettings(),
) -> tuple[np.ndarray, float]:
    """Move to the best of the points drawn about x, again and again, until none is worth a move.

    The points are normal with the given covariance times the squares of `RADII`.

    Args:
        covariance: of the coordinates, in which the points are drawn, shape (P, P).
        unit: unit of a gain in the cost, such as chi2 per degree of freedom.
    Returns:
        Coordinates of the end, shape (P,), and the last gain in that unit: the possible gain of a further move.
    """
    rng = np.random.default_rng(settings.draws_seed)
    spread, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(spread, 0.0))
    size = settings.points
    radius = np.repeat(RADII, -(-size // len(RADII)))[:size, None]
    here = float(cost(np.tile(x, (size, 1)))[0])  # as many points as below: the compiled program is used again
    gain = 0.0
    for _ in range(settings.draws):
        points = x + radius * rng.standard_normal((size, x.size)) @ root.T
        price = cost(points)
        best = int(np.argmin(price))
        gain = max(0.0, here - float(price[best])) / unit
        if gain < WORTH:
            break
        x, here = points[best], float(price[best])
    return x, gain


# ---- Optima near the one that was found, and the choice among them
#
# With an ECU in the model, a plate that sticks one tick later, turns a little earlier or holds instead of slipping
# makes other valleys of the sum of squares, a few percent of a parameter apart and about as deep. The fit is started
# again from points about its end, with errors of timing tolerated at first; again about a likelier end; and, if it
# ended in a valley that does not explain the data, from points about its start. Of all ends the likeliest is kept
# (`deviance`). The distances of the other ends belong to the parameters' covariance, weighted by their likelihoods to
# the power 1/T, because each end owes some of its likelihood to instants of slips and ticks that happen to fit:
#
#     C + sum_k w_k d_k d_k^T,    w_k = L_k^(1/T) / sum_j L_j^(1/T)
#
# The distances are of logarithms: ratios, which the data determine where no scale is known, are straight in them.
#
# Source: Wales and Doye 1997, Global optimization by basin-hopping; Kass and Raftery 1995, Bayes factors, sec. 4 (a
# mixture of modes). Differs from source: points are drawn about the likeliest end only, several at a time; modes are
# assumed to be equally wide, because rough surroundings hardly determine a mode's width; T.


NEIGHBOURHOOD = (0.15, 0.05)  # standard deviations of the points about the likeliest end, in reaches, in turn
FIRST_ROUNDS = 4  # first rounds from each of these points
NEARLY_SETTLED = 0.5  # movement in these rounds that counts as none, standard errors: such ends count as one
HOPEFUL = 40.0  # -2 log L above the least, above which an end is given up after those rounds
# searches at least, for ends in enough places, and at most; each further one is about a likelier end
ENOUGH, SEARCHES = 4, 6
LIKELIER = 4.0  # fall of -2 log L that justifies a further search
ROUGHNESS = 8.0  # T: with it 95 % of the intervals of the bank's training folders under an ECU hold (seeds from 17500)
EXPLAINED = 2.0
"""chi2 per sample above which an end does not explain the data: then points are drawn again about the start, as other
starts are."""


class _End(NamedTuple):
    """An end of the fit, and its -2 log L."""

    reached: Reached
    deviance: float


def likeliest_nearby(
    reached: Reached, start: Float[np.ndarray, " P"], report: Report, settings: FitSettings = FitSettings()
) -> Reached:
    """The likeliest of an end and those nearby, with the distances of the others in `Termination.wander`."""
    best = _End(reached, reached.deviance)
    if not settings.neighbours or not np.isfinite(best.deviance):
        return reached
    rng = np.random.default_rng(settings.seed)
    ends = [best]
    for k in range(SEARCHES):
        report(f"looking for likelier optima nearby, {k + 1} of at most {SEARCHES}", 0.9)
        ends += _ends_from(_points(best, start, rng, settings), best, start, settings)
        before, best = best.deviance, min(ends, key=lambda end: end.deviance)
        if k + 1 >= ENOUGH and before - best.deviance < LIKELIER and best.reached.misfit < EXPLAINED:
            break
    return _with_distances(finished(best.reached, quiet, settings), ends)


def _points(best: _End, start: np.ndarray, rng: np.random.Generator, settings: FitSettings) -> list[np.ndarray]:
    """Points about the end; about the start if the end does not explain the data."""
    layout, explained = best.reached.problem.layout, best.reached.misfit < EXPLAINED
    about, spreads = (best.reached.x, NEIGHBOURHOOD) if explained else (start, (settings.spread,))
    far = [spreads[k % len(spreads)] for k in range(settings.neighbours)]
    return [layout.off_bounds(about + each * layout.reach(about) * rng.standard_normal(about.size)) for each in far]


def _ends_from(points: list[np.ndarray], best: _End, start: np.ndarray, settings: FitSettings) -> list[_End]:
    """Ends of the fit from some points; points whose first rounds end far from the likeliest get no further rounds."""
    problem = best.reached.problem

    def first(point: np.ndarray) -> _End:
        point, _ = descend_in_stages(problem, point, ROUGH_TOLERANCE, settings)
        point = with_lag_of_start(start, problem, point)
        return _whitened(problem.with_instants(point), point, FIRST_ROUNDS, settings)

    found = concurrently(first, points)
    least = min(end.deviance for end in (best, *found)) + HOPEFUL
    return concurrently(lambda end: _further(end, settings) if end.deviance < least else end, found)


def _further(end: _End, settings: FitSettings) -> _End:
    """The end after the remaining rounds; the end itself if they do not make it likelier."""
    later = _whitened(end.reached.problem, end.reached.x, max(1, settings.rounds - FIRST_ROUNDS), settings)
    return min(end, later, key=lambda end: end.deviance)


def _whitened(problem: EstimationProblem, x: np.ndarray, most: int, settings: FitSettings) -> _End:
    reached = rounds(problem, x, quiet, NEARLY_SETTLED, most, settings)
    return _End(reached, reached.deviance)


def _with_distances(best: Reached, ends: list[_End]) -> Reached:
    """The best end with the distances of the others, each times the root of its weight."""
    every = np.array([end.deviance for end in ends])
    weight = np.exp(0.5 * (every.min() - every) / ROUGHNESS)
    # the others were given up before they reached an optimum
    kept, layout = every < every.min() + HOPEFUL, best.problem.layout
    away = np.array([layout.log_distance(best.x, end.reached.x) for end in ends])[kept]
    away *= np.sqrt(weight[kept] / weight[kept].sum())[:, None]
    own = best.end.wander if best.end.wander is not None else np.zeros((1, best.x.size))
    return best._replace(end=replace(best.end, wander=np.concatenate((own, away))))
