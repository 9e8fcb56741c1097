"""Intervals of the population's mean and spread, for a dozen units too."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.optimize import root_scalar
from scipy.special import ndtr

from ..settings import PopulationSettings
from .likelihood import Spread, View, Weighed, expected_hessian, maximised, spread_view, weigh
from .stack import Scaled

ALONE = 1e-8  # 1 - T below: the direction is told by this unit alone, its scatter is not seen
FAR = 1e4  # times its estimate, or the scale: a bound beyond is none


def mean_intervals(
    at: Weighed, level: float
) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"], Float[np.ndarray, "P 2"]]:
    """Standard errors (P,), degrees of freedom (P,) and intervals (P, 2) of the mean; NaN where no scatter is seen.

        g_u = G (I - T_u)^-1/2 G^T r_u,   T_u = G^T W_u G,   G G^T = C = (sum W)^-1,   r_u = W_u (x_u - mu)
        stderr_j^2 = sum_u g_uj^2,   degrees of freedom by Satterthwaite

    C itself takes the spread for known. The scatter of the units about the mean says the same without a model, and
    right even if all stated covariances are too small. (I - T)^-1/2 undoes that each unit pulled the mean towards
    itself: the sum is then exactly unbiased where the model does hold. A shared symbol has its interval by the same
    formula.

    Source: Bell and McCaffrey 2002 (CR2); Tipton 2015 (Psychological Methods 20) for few clusters. Differs from source:
    in information form, with the rank of T_u in place of a unit's design.
    """
    g = np.linalg.cholesky(at.mean_covariance)
    t = g.T @ at.weight @ g
    value, vector = np.linalg.eigh(0.5 * (t + np.swapaxes(t, 1, 2)))
    left = 1.0 - value
    wider = np.where(left > ALONE, 1.0 / np.sqrt(np.maximum(left, ALONE)), 0.0)
    half = (vector * wider[:, None, :]) @ np.swapaxes(vector, 1, 2)  # (I - T)^-1/2
    moves = np.einsum("ij,ujk,uk->ui", g, half, at.pull @ g)
    variance = np.sum(moves**2, axis=0)
    degrees = _degrees(g, t, half)
    with np.errstate(invalid="ignore"):
        seen = (degrees > 0.0) & (variance > 0.0)
        stderr = np.where(seen, np.sqrt(variance), np.nan)
        reach = stats.t.ppf(0.5 + 0.5 * level, np.where(seen, degrees, 1.0)) * stderr
    return stderr, np.where(seen, degrees, 0.0), np.stack([at.mean - reach, at.mean + reach], axis=1)


def _degrees(g: np.ndarray, t: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(sum_u v_uu)^2 / sum_uw v_uw^2 of the covariances v of g_uj and g_wj, for each symbol j."""
    k = np.einsum("uij,pj->upi", half, g)
    m = np.einsum("uij,upj->upi", t, k)
    own = np.einsum("upi,upi->up", k, m)
    cross = np.einsum("upi,upi->up", m, m)
    alone = own - cross  # v_uu; v_uw = -m_u m_w
    outer = np.einsum("upi,upj->pij", m, m)
    between = np.einsum("pij,pij->p", outer, outer) - np.sum(cross**2, axis=0)
    spread = np.sum(alone**2, axis=0) + np.maximum(between, 0.0)
    return np.where(spread > 0.0, np.sum(alone, axis=0) ** 2 / np.where(spread > 0.0, spread, 1.0), 0.0)


def spread_intervals(data: Scaled, best: Spread, settings: PopulationSettings) -> np.ndarray:
    """Intervals of the standard deviations between units: lower and upper bound of each symbol that differs, scaled,
    shape (Q, 2); infinite where there is no upper one.

        { d : min over all else of -2 log L(d) <= its least value + cut(d) }

    A profile of the restricted likelihood: lop-sided as it must be for few units, with 0 inside where the data do not
    show that units differ at all. Far from 0 the cut is the quantile of chi2, 3.84. Near 0 the least value is held at 0
    half of the time, the likelihood ratio is smaller, and 3.84 would hold 97.5 % and more; there the cut is that of a
    normal variance with a bound (2.71 at 0), as Feldman and Cousins 1998 (Phys. Rev. D 57, sec. IV B) order it. Where a
    standard deviation is known to a few percent the curvature says the same: d exp(+- z stderr / d). Symbols are
    looked at as where the standard deviations themselves are estimated (`spread_view`).
    """
    size = len(best.d)
    if not size:
        return np.zeros((0, 2))
    view = spread_view(data, best, settings)
    best = view.start
    stderr = _stderr(view, best)
    z = stats.norm.ppf(0.5 + 0.5 * settings.level)
    out = np.zeros((size, 2))
    for j, (d, error) in enumerate(zip(best.d, stderr, strict=True)):
        if d > 0.0 and error < settings.wald * d:
            out[j] = d * np.exp(np.array([-z, z]) * error / d)
        else:
            out[j] = _Profile(view, best, j, settings.level).bounds(float(error))
    return out


def _stderr(view: View, at: Spread) -> np.ndarray:
    """Standard error of each standard deviation, from the expected curvature at these values, scaled, shape (Q,)."""
    size = len(at.d)
    free = ~view.held
    hessian = expected_hessian(weigh(view.data, at, view.prior), at, view.prior)[np.ix_(free, free)]
    tiny = 1e-12 * (1.0 + np.max(np.diag(hessian)))
    inverse = np.linalg.inv(hessian + tiny * np.eye(len(hessian)))
    return np.sqrt(2.0 * np.maximum(np.diag(inverse)[:size], 0.0))


class _Profile:
    """-2 log L over one standard deviation, less its least value and the quantile: zero at the bounds."""

    def __init__(self, view: View, best: Spread, j: int, level: float) -> None:
        self.view, self.best, self.j, self.level = view, best, j, level
        self.least = weigh(view.data, best, view.prior).value
        self.held = view.held.copy()
        self.held[j] = True

    def __call__(self, d: float) -> float:
        start = self.best.vector.copy()
        start[: len(self.best.d)] = np.maximum(start[: len(self.best.d)], 1e-3)
        start[self.j] = d
        there = maximised(self.view.data, self.best.at(start), self.held, self.view.prior)
        at = weigh(self.view.data, there, self.view.prior)
        # d^2 over its standard error if d were the truth: d / (2 stderr of d)
        here = float(there.d[self.j])
        over = here / (2.0 * max(float(_stderr(self.view, there)[self.j]), 1e-150)) if here > 0.0 else 0.0
        return at.value - self.least - cut(over, self.level)

    def bounds(self, error: float) -> tuple[float, float]:
        d = float(self.best.d[self.j])
        low = 0.0
        if d > 0.0 and self(0.0) > 0.0:
            near = max(0.0, d - 2.0 * error)
            low = self.root(near if self(near) > 0.0 else 0.0, d)
        inner, outer = d, max(d + 2.0 * min(error, d), 0.05)
        while self(outer) < 0.0:
            inner, outer = outer, 2.0 * outer
            if outer > FAR * max(d, 1.0):
                return low, np.inf
        return low, self.root(inner, outer)

    def root(self, low: float, high: float) -> float:
        """Where the profile crosses its quantile."""
        return root_scalar(self, bracket=(low, high), method="brentq", xtol=1e-4 * high, rtol=1e-3).root


@cache
def _ends(level: float) -> tuple[float, float]:
    """The cut where the true value is 0, and where it is far from 0."""
    return float(stats.norm.ppf(level)) ** 2, float(stats.chi2.ppf(level, 1))


def cut(r: float, level: float) -> float:
    """The likelihood ratio below which x ~ N(r, 1) has r >= 0 in its interval, in `level` of all cases.

    x >= 0: (x - r)^2 <= c,   x < 0, where the best r is 0: r^2 - 2 x r <= c

    r is the truth over its standard error.
    """
    least, most = _ends(level)
    if r * r >= most:
        return most

    def lacking(c: float) -> float:
        root = np.sqrt(c)
        low = r - root if r >= root else (r * r - c) / (2.0 * max(r, 1e-12))
        return float(ndtr(root) - ndtr(low - r)) - level

    return float(root_scalar(lacking, bracket=(0.999 * least, 1.001 * most), method="brentq", xtol=1e-6).root)
