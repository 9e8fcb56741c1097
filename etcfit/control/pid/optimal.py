"""Our own rule: the gains that track the paper's trapezoid best on the nonlinear model and still meet what is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from ...model.linear import TransferFunction
from .base import Refusal, Task
from .gains import Gains
from .loop import Loop
from .margins import COARSE, margins
from .setpoint import Setpoint, trapezoid

CERTAIN = 0.95  # share of the draws that must meet everything
_FEW = 12  # draws during the search; all of them judge the end
_POPULATION, _ELITE = 48, 10  # gains tried at once, and those that lead on
_ROUNDS, _LAST_ROUNDS = 36, 12  # on the nominal model, which is cheap; over draws, from where that ended
_ABOUT = 0.15  # spread of the gains with which the latter begins, in their logarithm
_SWEEPS = 6  # populations scattered over all gains before
_SEARCHES = 3  # with a scatter of their own each: friction makes valleys whose floors differ by a few per cent
_SPARE = 0.03  # of each requirement kept in hand during the search, for draws that it did not see
_LOW, _HIGH = np.log((0.3, 0.3, 3e-3)), np.log((1e3, 3e5, 40.0))  # Kp, Ki, Kd: no optimum has been seen near an end
_NARROWEST = 0.01  # of the search in the logarithm of a gain
_WIDER = 1.5  # than the leaders' own covariance, lest the search narrows before it has arrived
_WEIGHT = 50.0  # of a requirement missed by its own size, in units of the tracking error


@dataclass(frozen=True, eq=False)
class Scores:
    """How gains (G) fare over draws (D).

    Args:
        rmse: mean over draws, %, shape (G,).
        excess: by how much the requirement missed worst is missed, relative, 0 if none, shape (D, G).
    """

    rmse: np.ndarray
    excess: np.ndarray

    @property
    def missed(self) -> np.ndarray:
        """What `CERTAIN` of the draws stay below, shape (G,)."""
        return np.quantile(self.excess, CERTAIN, axis=0)

    @property
    def cost(self) -> np.ndarray:
        """Tracking error, and any miss of a requirement dearer than all of it; shape (G,)."""
        rmse = np.nan_to_num(self.rmse, nan=1e3, posinf=1e3)
        missed = np.nan_to_num(self.missed, nan=1e3, posinf=1e3)
        return rmse * (1.0 + np.where(missed > 0.0, 1.0 + _WEIGHT * missed, 0.0))


Score = Callable[[np.ndarray], Scores]  # of logarithms of gains, shape (G, 3)


def optimal(task: Task) -> Gains | Refusal:
    """min mean RMSE over draws, subject to requirements and margins met by at least 95 % of the draws.

    Tracking error of the trapezoid of 5 to 45 % at 1 Hz (Eq. 9) on the fitted nonlinear model under its ECU. A sweep of
    scattered gains, then the cross-entropy method from the best of them, on the nominal model and then over draws; the
    best of a few such searches. Where no gains meet everything, those that miss least.

    Source: this project; Rubinstein and Kroese 2004, The Cross-Entropy Method, for the search. Differs from source: the
    spread is bounded from below, and the best so far is kept.
    """
    rng = np.random.default_rng(20230701)
    alone, few = _scorer(task, 1), _scorer(task, _FEW)
    ends = [_search(alone, few, rng) for _ in range(_SEARCHES)]
    best, _ = min(ends, key=lambda end: end[1])
    return Gains(*np.exp(best).tolist())


def _search(alone: Score, few: Score, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """From a scatter of its own to the best on few draws: logarithms of the gains, shape (3,), and their cost."""
    best, _ = _cross_entropy(alone, _swept(alone, rng), _ROUNDS, rng)
    about = best + _ABOUT * np.vstack((np.zeros(3), rng.standard_normal((_POPULATION - 1, 3))))
    return _cross_entropy(few, np.clip(about, _LOW, _HIGH), _LAST_ROUNDS, rng)


def _swept(score: Score, rng: np.random.Generator) -> np.ndarray:
    """The best population of several scattered over all gains, logarithms, shape (_POPULATION, 3)."""
    swept = _LOW + (_HIGH - _LOW) * qmc.Halton(3, rng=rng).random(_SWEEPS * _POPULATION)
    cost = np.concatenate([score(block).cost for block in np.split(swept, _SWEEPS)])
    return swept[np.argsort(cost)[:_POPULATION]]


def _cross_entropy(score: Score, begin: np.ndarray, rounds: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """The best logarithms of gains found, shape (3,), from a first population, and their cost."""
    cost = score(begin).cost
    order = np.argsort(cost)[:_ELITE]
    leaders, cost = begin[order], cost[order]
    for _ in range(rounds):
        middle = leaders.mean(axis=0)
        spread = _WIDER * np.cov(leaders.T) + _NARROWEST**2 * np.eye(3)
        tried = np.clip(rng.multivariate_normal(middle, spread, _POPULATION), _LOW, _HIGH)
        every = np.vstack((leaders, tried))
        costs = np.concatenate((cost, score(tried).cost))
        order = np.argsort(costs)[:_ELITE]
        leaders, cost = every[order], costs[order]
    return leaders[0], float(cost[0])


def _scorer(task: Task, draws: int) -> Score:
    loop = task.loop.first(draws)
    plants = loop.linear()
    setpoint = trapezoid()

    def score(logs: np.ndarray) -> Scores:
        return scores(task, Gains(*np.exp(logs).T), loop, plants, setpoint)

    return score


def scores(task: Task, gains: Gains, loop: Loop, plants: TransferFunction, setpoint: Setpoint) -> Scores:
    """Figures of gains of shape (G,) over the draws of a loop, whose linear plants have shape (D, 1)."""
    asked = task.requirements
    judged = loop.judged(gains, setpoint)
    gain, phase = margins(Gains(*(np.asarray(g)[None] for g in gains)), plants, loop.ecu, COARSE)
    longest = max(level.ends - level.begins for level in setpoint.levels)
    settling = np.minimum(np.asarray(judged.settling_s), 2.0 * longest)
    over = (
        np.asarray(judged.overshoot_pct) / asked.overshoot_pct,
        settling / asked.settling_s,
        np.asarray(judged.steady_state_error_pct) / asked.steady_state_error_pct,
        2.0 - gain / asked.gain_margin_db,
        2.0 - phase / asked.phase_margin_deg,
    )
    worst = np.max(np.stack([np.broadcast_to(each, over[0].shape) for each in over]), axis=0)
    return Scores(np.mean(np.asarray(judged.rmse_pct), axis=0), np.maximum(worst - 1.0 + _SPARE, 0.0))
