"""Profile likelihood: how much chi2 rises as one parameter is held off its optimum and all others follow.

    rise(q) = min over the others of chi2(x | q) - chi2(mode)

A parameter is known, to 95 %, where the rise stays below 3.84 (Wilks 1938; Raue et al. 2009). Its profile is
`bounded` where the rise crosses that on both sides, `one-sided` where on one, `flat` where on neither within the range
that is believed possible (three reaches either way, about a factor of 20). The factors f_s that temper the posterior
(`target`) divide chi2 here too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..estimation.identifiability import WIDE
from ..estimation.intervals import Z_95, intervals
from ..estimation.joint_fit import Report, quiet
from ..estimation.levenberg_marquardt import minimise
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import FreeParameters, Layout
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .sampling import Posterior
from .target import Target

RISE = 3.84  # 95 % quantile of chi2 with one degree of freedom
TOLERANCE = 1e-4  # relative change of chi2 that ends each refit
OFFSETS = (0.5, 1.0, 1.5, 2.0, 2.6)  # distances from the mode that are looked at first, standard deviations, rising
WIDENINGS, FACTOR = 8, 1.6  # times that the last of them is widened while chi2 has not risen enough, and by how much


@dataclass(frozen=True, eq=False)
class Profile:
    """The profile of one parameter, SI."""

    symbol: str  # which
    value: np.ndarray  # values at which it was held, rising, the mode's among them, shape (K,)
    rise: np.ndarray  # of chi2 there, shape (K,)
    # low, high: where the rise is 3.84; None on a side where it never is
    low: float | None
    high: float | None

    @property
    def kind(self) -> str:
        """ "bounded", "one-sided" or "flat"."""
        return ("flat", "one-sided", "bounded")[(self.low is not None) + (self.high is not None)]

    @property
    def sd(self) -> float | None:
        """Half the interval's width over 1.96; None where it is not bounded."""
        if self.low is None or self.high is None:
            return None
        return (self.high - self.low) / (2.0 * Z_95)


def weak(posterior: Posterior) -> tuple[str, ...]:
    """Free parameters that the data do not determine, or hardly."""
    verdict = posterior.fit.identifiability
    known = intervals(posterior.fit)
    named = {*verdict.lost, *(s for d in verdict.directions for s in d.symbols[:2])}
    named |= {s for s in posterior.chain.symbols if known[s].status == "not identifiable"}
    return tuple(s for s in posterior.chain.symbols if s in named)


def profiles(posterior: Posterior, report: Report = quiet) -> dict[str, Profile]:
    """Those of the weak parameters, by symbol."""
    symbols, out = weak(posterior), {}
    for k, symbol in enumerate(symbols):
        report(f"profile of {symbol}", k / len(symbols))
        out[symbol] = profile(posterior.target, symbol)
    return out


def profile(target: Target, symbol: str) -> Profile:
    """The profile of one free parameter of a density."""
    k = target.symbols.index(symbol)
    below, above = (_side(target, k, way) for way in (-1.0, 1.0))
    q = np.array([*(x for x, _ in reversed(below)), target.mode[k], *(x for x, _ in above)])
    rise = np.array([*(r for _, r in reversed(below)), 0.0, *(r for _, r in above)])
    domain = target.problem.layout.parameter(symbol).domain
    value = np.array([float(domain.value(x)) for x in q])
    low = crossing(value[: len(below) + 1][::-1], rise[: len(below) + 1][::-1])
    high = crossing(value[len(below) :], rise[len(below) :])
    return Profile(symbol, value, rise, low, high)


def _side(target: Target, k: int, way: float) -> list[tuple[float, float]]:
    """Coordinates and rises on one side of the mode, outward, until the rise is large enough or the range ends."""
    problem, mode = target.problem, target.mode
    sd, last = float(np.sqrt(target.covariance[k, k])), WIDE * float(problem.layout.reach(mode)[k])
    weighted = target.weighted
    if target.symbols[k] not in problem.free_parameters.priors:
        # without the broad prior on this coordinate, so that its profile shows data and the user's own priors
        prior_sd = np.array(weighted.prior_sd)
        prior_sd[k] = np.inf
        weighted = weighted._replace(prior_sd=prior_sd)
    least = float(chi2_of(problem, mode[None], weighted)[0])
    offsets = [s * sd for s in OFFSETS] + [OFFSETS[-1] * sd * FACTOR**d for d in range(1, WIDENINGS + 1)]
    out: list[tuple[float, float]] = []
    x = mode
    for offset in sorted({min(o, last) for o in offsets}):
        # the others set out from their regression on coordinate k: x + C_k (to - x_k) / C_kk
        to = mode[k] + way * offset
        guess = x + target.covariance[:, k] / target.covariance[k, k] * (to - x[k])
        x = _refitted(problem, weighted, guess, k)
        out.append((float(x[k]), float(chi2_of(problem, x[None], weighted)[0]) - least))
        if out[-1][1] > RISE:
            break
    return out


def _refitted(problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, k: int) -> np.ndarray:
    """Coordinates with the k-th held and the others at their optimum, shape (P,).

    Which parameters are free is data to the compiled functions, so nothing is compiled again.
    """
    lean = _holding(problem, x, k)
    others = np.delete(np.arange(x.size), k)
    gone = weighted._replace(
        pick=lean.pick,
        prior_mean=lean.layout.padded(np.asarray(weighted.prior_mean)[others]),
        prior_sd=lean.layout.padded(np.asarray(weighted.prior_sd)[others], np.inf),
    )
    out = x.copy()
    out[others] = minimise(lean, x[others], gone, TOLERANCE)[0]
    return out


def _holding(problem: EstimationProblem, x: np.ndarray, k: int) -> EstimationProblem:
    """The problem with its k-th free parameter held at its value at x."""
    layout, free_parameters = problem.layout, problem.free_parameters
    symbol, value = layout.free[k], layout.numbers(x)[0][k]
    free = tuple(s for s in layout.free if s != symbol)
    fewer = Layout(layout.types, layout.parameters, free, (*layout.held, symbol), layout.ties,
                   max(layout.room, x.size))  # fmt: skip
    held = np.append(free_parameters.held, value)
    return problem.with_parameters(
        FreeParameters(
            fewer, held, {s: p for s, p in free_parameters.priors.items() if s in free}, free_parameters.start
        )
    )


def crossing(value: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the rise of chi2 first reaches 3.84, going outward; None where it never does.

    Between two points sqrt(rise) is taken as a straight line, which it is where chi2 is a parabola.

    Args:
        value: at which the parameter was held, the mode's first, shape (K,).
        rise: of chi2 there, shape (K,).
    """
    root, threshold = np.sqrt(np.maximum(rise, 0.0)), np.sqrt(RISE)
    beyond = np.flatnonzero(root >= threshold)
    if not beyond.size:
        return None
    j = int(beyond[0])
    share = (threshold - root[j - 1]) / (root[j] - root[j - 1])
    return float(value[j - 1] + share * (value[j] - value[j - 1]))
