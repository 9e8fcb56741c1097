"""The restricted likelihood of a covariance between units, given their estimates with uncertainties, and its maximum.

`population` estimates the covariance with it, `intervals` its intervals; `distances` uses its weights.

    estimate_u = theta_u + e_u,   theta_u ~ N(mu, Omega),   e_u ~ N(0, F_u^-1),   F_u = H_u^T H_u
    M_u = I + H_u Omega H_u^T,   W_u = H_u^T M_u^-1 H_u  (= (F_u^-1 + Omega)^-1 where F_u is regular)
    mu = (sum W_u)^-1 sum W_u x_u
    -2 log L = sum log|M_u| + sum e_u^T M_u^-1 e_u + log|sum W_u|,   e_u = H_u (x_u - mu)

The last term makes it restricted (REML): it removes the bias that the spread would have because the mean is estimated
from the same units. A prior with the weight of nu uncorrelated units, -nu log|R| of the correlation matrix R, keeps
correlations off +-1 where units are few, and is negligible where they are many. `View` explains its effect on standard
deviations.

Source: Laird and Ware 1982 (Biometrics 38), eqs. 3.2-3.5; Harville 1977 (JASA 72). Differs from source: information
instead of design matrices; the prior is that of Lewandowski, Kurowicka and Joe 2009; Fisher scoring instead of EM,
which takes thousands of steps where a spread is near zero.

Intervals of the population's mean and spread, for a dozen units too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats
from scipy.optimize import minimize, root_scalar
from scipy.special import ndtr

from ..settings import PopulationSettings
from .stack import Scaled

ENOUGH = 4.0  # units for each symbol that differs, from which on all standard deviations are estimated together
STEPS = 200  # most quasi-Newton steps
TOLERANCE = 1e-6  # promised fall of minus twice the log likelihood below which they end


@dataclass(frozen=True, eq=False)
class Spread:
    """A covariance between units in unconstrained coordinates: standard deviations and correlations.

        Omega = D C C^T D,   D = diag(d),   row j of C = (a_j1, ..., a_j,j-1, 1, 0, ...) / norm

    |d_j| is a standard deviation and C C^T is a correlation matrix for every a: there are no bounds, d_j = 0 is an
    ordinary point, and a profile over one standard deviation is an ordinary fit with d_j held. Shared symbols have no
    d.
    """

    own: Bool[np.ndarray, " P"]  # whether a symbol differs between units
    d: Float[np.ndarray, " Q"]  # standard deviations, with sign, of the Q symbols that do
    a: Float[np.ndarray, " A"]  # the strictly lower triangle, row by row, Q (Q - 1) / 2 entries

    @property
    def vector(self) -> Float[np.ndarray, " K"]:
        """(d, a)."""
        return np.concatenate([self.d, self.a])

    def at(self, vector: Float[np.ndarray, " K"]) -> Spread:
        """The spread of the same symbols with other numbers."""
        return Spread(self.own, vector[: len(self.d)], vector[len(self.d) :])

    @property
    def uncorrelated(self) -> Spread:
        """The spread with the same standard deviations and no correlations."""
        return Spread(self.own, self.d, np.zeros_like(self.a))

    @cached_property
    def rows(self) -> Float[np.ndarray, "Q Q"]:
        """C: rows of length one."""
        full = np.eye(len(self.d))
        full[np.tril_indices(len(self.d), -1)] = self.a
        return full / np.sqrt(np.sum(full**2, axis=1, keepdims=True))

    @property
    def squared_lengths(self) -> Float[np.ndarray, " A"]:
        """Squared length, before scaling, of the row of each entry of a (its last entry is then 1)."""
        row, _ = np.tril_indices(len(self.d), -1)
        return np.diag(self.rows)[row] ** -2

    @property
    def covariance(self) -> Float[np.ndarray, "P P"]:
        """Omega, with zeros for shared symbols."""
        out = np.zeros((len(self.own), len(self.own)))
        root = self.d[:, None] * self.rows
        out[np.ix_(self.own, self.own)] = root @ root.T
        return out

    @property
    def slopes(self) -> Float[np.ndarray, "K Q Q"]:
        """dOmega / d(d, a) of the symbols that differ."""
        size = len(self.d)
        rows = self.rows
        out = np.zeros((size + len(self.a), size, size))
        turned = rows @ (self.d[:, None] * rows).T  # row j: c_j^T L^T
        for j in range(size):
            out[j, j] += turned[j]
            out[j, :, j] += turned[j]
        row, column = np.tril_indices(size, -1)
        norm = 1.0 / np.diag(rows)  # of row j before it was scaled, as its last entry was 1
        for k, (j, m) in enumerate(zip(row, column, strict=True)):
            change = -rows[j] * rows[j, m] / norm[j]
            change[m] += 1.0 / norm[j]
            effect = self.d[j] * change @ (self.d[:, None] * rows).T
            out[size + k, j] += effect
            out[size + k, :, j] += effect
        return out


@dataclass(frozen=True, eq=False)
class Weighed:
    """The likelihood and the mean of the units under one covariance between them."""

    value: float  # -2 log L, restricted, prior included
    mean: Float[np.ndarray, " P"]  # mu
    mean_covariance: Float[np.ndarray, "P P"]  # (sum W)^-1
    weight: Float[np.ndarray, "N P P"]  # W
    pull: Float[np.ndarray, "N P"]  # W (x - mu)


def weights(data: Scaled, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M (N, P, P) and M^-1 H (N, P, P), which W and the distances need."""
    m = np.eye(data.x.shape[1]) + data.root @ covariance @ np.swapaxes(data.root, 1, 2)
    return m, np.linalg.solve(m, data.root)


def weigh(data: Scaled, spread: Spread, prior: float) -> Weighed:
    """The likelihood, the mean and the weights under one covariance."""
    m, solved = weights(data, spread.covariance)
    y = np.einsum("ujk,uk->uj", data.root, data.x)
    weight = np.swapaxes(data.root, 1, 2) @ solved
    total = weight.sum(axis=0)
    inverse = np.linalg.inv(total)
    # M is symmetric: (M^-1 H)^T y = H^T M^-1 y
    weighed = np.einsum("ukj,uk->uj", solved, y)
    mean = inverse @ weighed.sum(axis=0)
    error = y - data.root @ mean
    pull = np.einsum("ukj,uk->uj", solved, error)
    squares = float(np.sum(error * np.linalg.solve(m, error[:, :, None])[:, :, 0]))
    determinants = float(np.sum(np.linalg.slogdet(m)[1]) + np.linalg.slogdet(total)[1])
    tied = -2.0 * prior * float(np.sum(np.log(np.diag(spread.rows))))
    return Weighed(determinants + squares + tied, mean, 0.5 * (inverse + inverse.T), weight, pull)


def gradient(at: Weighed, spread: Spread, prior: float) -> Float[np.ndarray, " K"]:
    """Gradient of -2 log L in (d, a): sum tr[(W - r r^T - W C W) dOmega],   C = (sum W)^-1."""
    own, size = spread.own, int(spread.own.sum())
    all_symbols = at.pull.shape[1]
    lifted = at.weight @ at.mean_covariance
    rows = np.swapaxes(lifted, 0, 1).reshape(all_symbols, -1)  # (i, u j)
    doubled = rows @ at.weight.reshape(-1, all_symbols)  # sum W C W
    g = at.weight.sum(axis=0) - at.pull.T @ at.pull - doubled
    out = np.einsum("kij,ij->k", spread.slopes, 0.5 * (g + g.T)[np.ix_(own, own)])
    out[size:] += 2.0 * prior * spread.a / spread.squared_lengths
    return out


def expected_hessian(at: Weighed, spread: Spread, prior: float) -> Float[np.ndarray, "K K"]:
    """Expected Hessian of -2 log L in (d, a): sum tr(W E_k W E_l),   E_k = dOmega / d(d, a)_k."""
    own, size, e = spread.own, int(spread.own.sum()), spread.slopes
    flat = at.weight[:, own][:, :, own].reshape(len(at.weight), size * size)
    four = (flat.T @ flat).reshape(size, size, size, size)  # sum W_ab W_cd
    turned = four.transpose(1, 2, 3, 0).reshape(size * size, size * size)  # (bc), (da)
    columns = e.reshape(len(e), size * size)
    swapped = np.swapaxes(e, 1, 2).reshape(len(e), size * size)
    hessian = columns @ turned @ swapped.T
    hessian[np.diag_indices(len(e))] += np.concatenate([np.zeros(size), 2.0 * prior / spread.squared_lengths])
    return 0.5 * (hessian + hessian.T)


def maximised(data: Scaled, start: Spread, held: Bool[np.ndarray, " K"], prior: float = 0.0) -> Spread:
    """The covariance of highest restricted likelihood: quasi-Newton in coordinates whose expected Hessian is one.

    With many units the expected Hessian is the true one, and a step or two is enough; with few, BFGS learns the rest.

    Args:
        start: start of the search, with d > 0 where d is free: at 0 the slope is always 0.
        held: entries of (d, a) that stay fixed.
        prior: weight of the prior of the correlations, in units.
    """
    if np.all(held):
        return start
    free, origin = np.flatnonzero(~held), start.vector
    hessian = expected_hessian(weigh(data, start, prior), start, prior)
    h = hessian[np.ix_(free, free)]
    root = np.linalg.cholesky(h + np.diag(1e-3 * np.diag(h) + 1e-9 * (1.0 + np.max(np.diag(h)))))

    def spread(z: np.ndarray) -> Spread:
        vector = origin.copy()
        vector[free] += np.linalg.solve(root.T, z)
        return start.at(vector)

    def value(z: np.ndarray) -> tuple[float, np.ndarray]:
        tried = spread(z)
        here = weigh(data, tried, prior)
        return here.value, np.linalg.solve(root, gradient(here, tried, prior)[free])

    nearly = float(np.sqrt(2.0 * TOLERANCE / len(free)))
    options = {"gtol": nearly, "maxiter": STEPS}
    found = spread(minimize(value, np.zeros(len(free)), jac=True, method="BFGS", options=options).x)
    # the same covariance with no d below 0: the product of two signs is the sign of a correlation
    sign = np.where(found.d < 0.0, -1.0, 1.0)
    row, column = np.tril_indices(len(found.d), -1)
    return Spread(found.own, np.abs(found.d), found.a * sign[row] * sign[column])


class View(NamedTuple):
    """The data from which the standard deviations between units are estimated: all symbols together, or one by one.

    The joint estimate is the most accurate, because the errors of a unit are correlated, and so are the units. But it
    needs P (P - 1) / 2 correlations of P symbols. Few units do not determine them, and a prior that keeps them off +-1
    biases the standard deviations too. So where there are fewer than `ENOUGH` units for each symbol, each symbol is
    estimated alone, with its marginal errors. Where there are more, a prior with the weight of one unit is enough, and
    its bias is small.
    """

    data: Scaled  # the units, joint or marginal
    start: Spread  # where the search starts
    held: Bool[np.ndarray, " K"]  # entries of (d, a) that it leaves alone
    prior: float  # weight of the prior of the correlations, in units


def spread_view(data: Scaled, start: Spread, settings: PopulationSettings) -> View:
    """The view of these units for a search that starts at a spread."""
    correlations = np.arange(len(start.vector)) >= len(start.d)
    if len(data.x) >= ENOUGH * len(start.d) or np.any(data.tells.sum(axis=0) < 2):
        return View(data, start, np.zeros_like(correlations), settings.uncorrelated)
    return View(data.marginal, start.uncorrelated, correlations, 0.0)


ALONE = 1e-8  # least 1 - T: below it this unit alone determines the direction, and its scatter is unknown
FAR = 1e4  # times the estimate, or the scale: a bound beyond counts as infinite


def mean_intervals(
    at: Weighed, level: float
) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"], Float[np.ndarray, "P 2"]]:
    """Standard errors (P,), degrees of freedom (P,) and intervals (P, 2) of the mean; NaN where the scatter is unknown.

        g_u = G (I - T_u)^-1/2 G^T r_u,   T_u = G^T W_u G,   G G^T = C = (sum W)^-1,   r_u = W_u (x_u - mu)
        stderr_j^2 = sum_u g_uj^2,   degrees of freedom by Satterthwaite

    C itself assumes that the spread is known. The scatter of the units about the mean gives the same without a model,
    and it is right even if all stated covariances are too small. (I - T)^-1/2 corrects for the pull of each unit on the
    mean: the sum is then exactly unbiased where the model holds. The interval of a shared symbol follows from the same
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

    A profile of the restricted likelihood: asymmetric for few units, and containing 0 where the data do not show that
    units differ. Far from 0 the cut is the quantile of chi2, 3.84. Near 0 the optimum is at the bound in half of the
    cases, the likelihood ratio is smaller, and 3.84 would cover 97.5 % and more; there the cut is that of a normal
    variable with a bound (2.71 at 0), by the ordering of Feldman and Cousins 1998 (Phys. Rev. D 57, sec. IV B). Where a
    standard deviation is known to a few per cent the curvature gives the same interval: d exp(+- z stderr / d). The
    symbols are taken together or one by one as for the standard deviations themselves (`spread_view`).
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
        """Standard deviation at which the profile crosses its quantile."""
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
