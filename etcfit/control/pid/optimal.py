"""The rule `optimal`: the gains with the least tracking error on the nonlinear model that meet all requirements in
every scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model.pid import Gains
from ...problem.cores import concurrently
from ..loop_figures import LoopFigures
from ..settings import OptimumSettings
from .base import Refusal, Task
from .formulas import FORMULAS
from .linear_loop import COARSE, OpenLoop
from .loop import Loop


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of gains (G) over draws (D)."""

    rmse: np.ndarray  # mean over draws, %, shape (G,)
    excess: np.ndarray  # relative excess over the requirement missed worst, 0 if none is missed, shape (D, G)
    settings: OptimumSettings = OptimumSettings()  # for `certain`

    @property
    def missed(self) -> np.ndarray:
        """Mean log(1 + excess) of the draws, 0 where the share `certain` of them meets every requirement; shape (G,).

        The mean favours many draws that meet the requirements where not enough can; the logarithm limits the influence
        of a draw that cannot.
        """
        enough = np.quantile(self.excess, self.settings.certain, axis=0) <= 0.0
        return np.where(enough, 0.0, np.mean(np.log1p(self.excess), axis=0))

    @property
    def cost(self) -> np.ndarray:
        """Tracking error, plus a penalty for missed requirements that outweighs it; shape (G,)."""
        rmse = np.nan_to_num(self.rmse, nan=1e3, posinf=1e3)
        missed = np.nan_to_num(self.missed, nan=1e3, posinf=1e3)
        return rmse * (1.0 + np.where(missed > 0.0, 1.0 + _WEIGHT * missed, 0.0))


_WEIGHT = 50.0  # cost of missing a requirement by its own size, in units of the tracking error
_SAFETY = 100.0  # weight of a missed stability margin over that of a requirement missed by the same share
_SPARE_ALONE = 0.12  # reserve to each requirement, as a share, on the nominal model alone, which has one noise sequence
_WIDER = 1.5  # factor on the covariance of the elite, so that the search does not narrow too early
_NARROWEST = 0.01  # least standard deviation of a population in the logarithm of a gain
_WORST = 180.0  # dB or degrees by which an unstable loop misses a margin where no change of gain or phase stabilises it

Score = Callable[[np.ndarray], Scores]  # of logarithms of gains, shape (G, 3)


def optimal(task: Task) -> Gains | Refusal:
    """min mean RMSE over draws, subject to requirements and margins met by at least 95 % of the draws.

    The objective is the tracking error of the trapezoid of 5 to 45 % at 1 Hz (Eq. 9), or of a log where that is larger,
    on the fitted nonlinear model under its ECU with the sensor's noise. Each requirement is that of the worst scenario.
    The search: a sweep of scattered gains, then the cross-entropy method from the best of them on the nominal model, a
    few times; then the same over a few draws, from the best of these results and of the rules by formula, as far as
    they lie apart, because the nominal model does not show which local optimum is the best over draws; the best of the
    elite over all draws is taken. Where no gains meet every requirement, the gains with the least excess.

    Source: this project; Rubinstein and Kroese 2004, The Cross-Entropy Method, for the search. Differs from source: the
    spread is bounded from below, and the best so far is kept.
    """
    settings = task.settings.optimum
    rng = np.random.default_rng(settings.seed)
    alone = _scorer(task, 1, _SPARE_ALONE)
    ends = [cross_entropy(alone, _swept(alone, rng, settings), settings.rounds, rng, settings)[0]
            for _ in range(settings.searches)]  # fmt: skip
    # the gains of the rules by formula: they may lie near local optima that the nominal model hides
    found = (rule(task) for rule in FORMULAS)
    ends += [np.log(np.clip(gains, settings.lowest, settings.highest)) for gains in found if isinstance(gains, Gains)]
    return best_over_draws(task, np.array(ends), rng)


def best_over_draws(task: Task, begins: np.ndarray, rng: np.random.Generator) -> Gains:
    """The gains with the least cost over all models of a task, sought over the first few from the best of some starts.

    Where all models together miss a requirement that the first few meet, the search is repeated with a larger reserve.

    Args:
        task: the task; the search uses its first few models.
        begins: starts, logarithms of gains, shape (B, 3).
    """
    settings = task.settings.optimum
    every = _scorer(task, task.loop.draws, 0.0)
    ends: list[tuple[float, np.ndarray]] = []
    for spare in settings.spares:
        begins = best_of_several(_scorer(task, settings.few, spare), begins, rng, settings)
        found = every(begins)
        best = int(np.argmin(found.cost))
        ends.append((float(found.cost[best]), begins[best]))
        if found.missed[best] == 0.0:
            break
    _, gains = min(ends, key=lambda end: end[0])
    return Gains(*np.exp(gains).tolist())


def best_of_several(
    score: Score, begins: np.ndarray, rng: np.random.Generator, settings: OptimumSettings = OptimumSettings()
) -> np.ndarray:
    """The best of several searches, each from one of the best starts, no start near another.

    A search whose cost is not near the least after half of its populations ends there.

    Args:
        begins: starts, logarithms of gains, shape (B, 3).
    Returns:
        logarithms of gains, shape (elite, 3), the best first.
    """

    def first_half(start: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
        return *elite_of(score, _about(start, rng, settings), half, rng, settings), rng

    half = settings.last_rounds // 2
    starts = _apart(begins[np.argsort(score(begins).cost)], settings)
    searches = concurrently(lambda each: first_half(*each), list(zip(starts, rng.spawn(len(starts)), strict=True)))
    least = min(cost[0] for _, cost, _ in searches)
    near = [search for search in searches if search[1][0] <= _NEAR * least]
    found = concurrently(lambda search: improved(score, *search, settings.last_rounds - half, settings), near)
    leaders, cost = (np.concatenate(each) for each in zip(*found, strict=True))
    return leaders[np.argsort(cost)[: settings.elite]]


_NEAR = 1.1  # cost over the least one, at half of the search, of the searches that go on
_ABOUT = 0.15  # standard deviation of the logarithm of the gains in the first population of a search


def _apart(begins: np.ndarray, settings: OptimumSettings) -> list[np.ndarray]:
    """The first few starts of which none lies in the population about another one."""
    kept: list[np.ndarray] = []
    for begin in begins:
        if all(np.max(np.abs(begin - other)) > _ABOUT for other in kept):
            kept.append(begin)
    return kept[: settings.starts]


def best_from(task: Task, begin: Gains, rounds: int) -> tuple[Gains, LoopFigures, float]:
    """The best gains near some gains after `rounds` populations, their figures on the nominal model, and `missed`."""
    settings = task.settings.optimum
    rng = np.random.default_rng(settings.seed)
    score = _scorer(task, task.loop.draws, settings.spares[0])
    start = _about(np.log(np.maximum(begin, settings.lowest)), rng, settings)
    best, _ = cross_entropy(score, start, rounds, rng, settings)
    gains = Gains(*np.exp(best).tolist())
    figures = task.loop.first(1).figures(Gains.stacked(gains), task.setpoint)
    return gains, figures.each(lambda figure: float(figure[0, 0])), float(score(best[None]).missed[0])


def _about(best: np.ndarray, rng: np.random.Generator, settings: OptimumSettings) -> np.ndarray:
    """A population about the best gains so far, which are its first member; logarithms, shape (population, 3)."""
    low, high = _ends(settings)
    scatter = np.vstack((np.zeros(3), rng.standard_normal((settings.population - 1, 3))))
    return np.clip(best + _ABOUT * scatter, low, high)


def _ends(settings: OptimumSettings) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the least and the largest gains, shape (3,) each."""
    return np.log(settings.lowest), np.log(settings.highest)


def _swept(score: Score, rng: np.random.Generator, settings: OptimumSettings) -> np.ndarray:
    """The best of several populations scattered over the whole range, logarithms of gains, shape (population, 3)."""
    from scipy.stats import qmc

    low, high = _ends(settings)
    swept = low + (high - low) * qmc.Halton(3, rng=rng).random(settings.sweeps * settings.population)
    cost = np.concatenate([score(block).cost for block in np.split(swept, settings.sweeps)])
    return swept[np.argsort(cost)[: settings.population]]


def cross_entropy(
    score: Score,
    begin: np.ndarray,
    rounds: int,
    rng: np.random.Generator,
    settings: OptimumSettings = OptimumSettings(),
) -> tuple[np.ndarray, float]:
    """The best of `elite_of`: logarithms of gains, shape (3,), and their cost; arguments as there."""
    leaders, cost = elite_of(score, begin, rounds, rng, settings)
    return leaders[0], float(cost[0])


def elite_of(
    score: Score,
    begin: np.ndarray,
    rounds: int,
    rng: np.random.Generator,
    settings: OptimumSettings = OptimumSettings(),
) -> tuple[np.ndarray, np.ndarray]:
    """Draw populations about the mean and covariance of the best gains so far; the best gains are always kept.

    Args:
        begin: first population, logarithms, shape (G, 3).
        rounds: number of populations after it.
    Returns:
        the best logarithms of gains found, shape (elite, 3), and their cost, shape (elite,), the best first.
    """
    cost = score(begin).cost
    order = np.argsort(cost)[: settings.elite]
    return improved(score, begin[order], cost[order], rng, rounds, settings)


def improved(
    score: Score,
    leaders: np.ndarray,
    cost: np.ndarray,
    rng: np.random.Generator,
    rounds: int,
    settings: OptimumSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """The elite after some more populations; arguments and result as of `elite_of`, whose result may be passed on."""
    low, high = _ends(settings)
    for _ in range(rounds):
        middle = leaders.mean(axis=0)
        spread = _WIDER * np.cov(leaders.T) + _NARROWEST**2 * np.eye(3)
        tried = np.clip(rng.multivariate_normal(middle, spread, settings.population), low, high)
        every = np.vstack((leaders, tried))
        costs = np.concatenate((cost, score(tried).cost))
        order = np.argsort(costs)[: settings.elite]
        leaders, cost = every[order], costs[order]
    return leaders, cost


def _scorer(task: Task, draws: int, spare: float) -> Score:
    """The score over the first `draws` models, with a reserve to each requirement."""
    loop = task.loop.first(draws)
    linear = OpenLoop.of_plants(loop.linear(), loop.ecu, COARSE)

    def score(logs: np.ndarray) -> Scores:
        return scores(task, Gains(*np.exp(logs).T), loop, linear, spare)

    return score


def scores(task: Task, gains: Gains, loop: Loop, linear: OpenLoop, spare: float) -> Scores:
    """Scores of gains (G,) over the draws of a loop, linear plants (D, 1); `spare`: reserve as a share of the
    limits."""
    required, figures = task.requirements, loop.figures(gains, task.setpoint)
    gain, phase = (np.maximum(m, -_WORST) for m in linear.margins(gains))
    longest = max(level.ends - level.begins for level in task.setpoint.levels)
    settled = replace(figures, settling_s=np.minimum(figures.settling_s, 2.0 * longest))
    settings = task.settings.optimum
    over = [strain - 1.0 for strain in required.strain(settled).values()]
    short = (1.0 - gain / required.gain_margin_db, 1.0 - phase / required.phase_margin_deg)
    over += [each + (_SAFETY - 1.0) * np.maximum(each, 0.0) for each in short]
    worst = np.max(np.stack([np.broadcast_to(each, figures.rmse_pct.shape) for each in over]), axis=0)
    rmse = np.mean(figures.rmse_pct, axis=0)
    return Scores(rmse, np.maximum(worst + spare, 0.0), settings)


SHARES = (0.85, 0.7, 0.55, 0.4, 0.25)  # limits of the activity over that of the best gains without a limit


@dataclass(frozen=True)
class FrontPoint:
    """The best gains within a limit of the duty's activity."""

    limit: float  # limit of the activity, %; infinite for none
    gains: Gains
    activity: float  # activity of these gains, %
    rmse: float  # tracking error, % of the travel
    meets: bool  # whether they meet all other requirements


def front(task: Task, begin: Gains) -> tuple[FrontPoint, ...]:
    """The front on the nominal model, from the largest activity to the least; each search starts at the result before.

    The first point has no limit; the limits of the others are shares of its activity.
    """
    alone, points = replace(task, loop=task.loop.first(1)), list[FrontPoint]()
    for share in (math.inf, *SHARES):
        limit = share * points[0].activity if points else math.inf
        here = replace(alone, requirements=replace(task.requirements, duty_activity_pct=limit))
        begin, figures, missed = best_from(here, begin, task.settings.front.rounds)
        points.append(FrontPoint(limit, begin, figures.duty_activity_pct, figures.rmse_pct, missed == 0.0))
    return carried(points)


def carried(points: Sequence[FrontPoint]) -> tuple[FrontPoint, ...]:
    """The points, each with the gains of a calmer point where those track better: they are within every looser
    limit."""
    best = [points[-1]]
    for point in reversed(points[:-1]):
        calmer = best[-1]
        better = calmer.meets and not (point.meets and point.rmse <= calmer.rmse)
        best.append(replace(calmer, limit=point.limit) if better else point)
    return tuple(reversed(best))
