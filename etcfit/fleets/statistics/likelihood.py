"""How well a covariance between units agrees with their estimates, their own uncertainty taken into account.

    estimate_u = theta_u + e_u,   theta_u ~ N(mu, Omega),   e_u ~ N(0, F_u^-1),   F_u = H_u^T H_u
    M_u = I + H_u Omega H_u^T,   W_u = H_u^T M_u^-1 H_u  (= (F_u^-1 + Omega)^-1 where F_u is regular)
    mu = (sum W_u)^-1 sum W_u x_u
    -2 log L = sum log|M_u| + sum e_u^T M_u^-1 e_u + log|sum W_u|,   e_u = H_u (x_u - mu)

The last term makes it restricted (REML): the spread is not estimated low because the mean was taken from the same few
units. A prior of nu uncorrelated units' worth, -nu log|R| of the correlation matrix R, keeps correlations off +-1 where
units are few, and is lost in the data where they are many. `View` says how far it moves standard deviations.

Source: Laird and Ware 1982 (Biometrics 38), eqs. 3.2-3.5; Harville 1977 (JASA 72). Differs from source: information
instead of design matrices; the prior is that of Lewandowski, Kurowicka and Joe 2009; Fisher scoring instead of EM,
which takes thousands of steps where a spread is near zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from ..settings import PopulationSettings
from .stack import Scaled

ENOUGH = 4.0  # units for each symbol that differs from which on all standard deviations are estimated together
STEPS = 200  # quasi-Newton steps at most
TOLERANCE = 1e-6  # fall of minus twice the log likelihood still promised that ends them


@dataclass(frozen=True, eq=False)
class Spread:
    """A covariance between units as numbers that may take any value: standard deviations and correlations.

        Omega = D C C^T D,   D = diag(d),   row j of C = (a_j1, ..., a_j,j-1, 1, 0, ...) / norm

    |d_j| is a standard deviation and C C^T the correlation matrix, whatever a is: no bound is ever hit, d_j = 0 is an
    ordinary point, and a profile over one standard deviation is an ordinary fit with d_j held. Shared symbols have no
    d.
    """

    own: Bool[np.ndarray, " P"]  # whether a symbol differs between units
    d: Float[np.ndarray, " Q"]  # of those Q that do
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
        """With the same standard deviations."""
        return Spread(self.own, self.d, np.zeros_like(self.a))

    @cached_property
    def rows(self) -> Float[np.ndarray, "Q Q"]:
        """C: rows of length one."""
        full = np.eye(len(self.d))
        full[np.tril_indices(len(self.d), -1)] = self.a
        return full / np.sqrt(np.sum(full**2, axis=1, keepdims=True))

    @property
    def squared_lengths(self) -> Float[np.ndarray, " A"]:
        """Squared length of the row of each entry of a before scaling, when its last entry was 1."""
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
    """Units under one covariance between them."""

    value: float  # -2 log L, restricted, prior included
    mean: Float[np.ndarray, " P"]  # mu
    mean_covariance: Float[np.ndarray, "P P"]  # (sum W)^-1
    weight: Float[np.ndarray, "N P P"]  # W
    pull: Float[np.ndarray, "N P"]  # W (x - mu)


def weights(data: Scaled, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M (N, P, P) and M^-1 H (N, P, P): for W and distances."""
    m = np.eye(data.x.shape[1]) + data.root @ covariance @ np.swapaxes(data.root, 1, 2)
    return m, np.linalg.solve(m, data.root)


def weigh(data: Scaled, spread: Spread, prior: float) -> Weighed:
    """Everything about one covariance but its slope."""
    m, solved = weights(data, spread.covariance)
    y = np.einsum("ujk,uk->uj", data.root, data.x)
    weight = np.swapaxes(data.root, 1, 2) @ solved
    total = weight.sum(axis=0)
    inverse = np.linalg.inv(total)
    # M is symmetric: (M^-1 H)^T y = H^T M^-1 y
    drawn = np.einsum("ukj,uk->uj", solved, y)
    mean = inverse @ drawn.sum(axis=0)
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
    beside = np.swapaxes(lifted, 0, 1).reshape(all_symbols, -1)  # (i, u j)
    doubled = beside @ at.weight.reshape(-1, all_symbols)  # sum W C W
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
        data: units.
        start: with d > 0 in what shall move: at nought the slope is always nought.
        held: entries of (d, a) that stay.
        prior: of the correlations, units' worth.
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
    # the same covariance with no d below nought: a pair of signs is a correlation's sign
    sign = np.where(found.d < 0.0, -1.0, 1.0)
    row, column = np.tril_indices(len(found.d), -1)
    return Spread(found.own, np.abs(found.d), found.a * sign[row] * sign[column])


class View(NamedTuple):
    """What standard deviations between units are estimated from: all symbols together, or each for itself.

    Together they are told best: a unit's errors are correlated, and so are the units. But of P symbols P (P - 1) / 2
    correlations are to be told besides. Few units tell none, and a prior that keeps them off +-1 draws the standard
    deviations with it: where units are fewer than `ENOUGH` a symbol each symbol is taken for itself, with its marginal
    errors. Where they are more, one unit's worth of prior will do, and draws by a unit's share.
    """

    data: Scaled  # units as they are looked at
    start: Spread  # where the search starts
    held: Bool[np.ndarray, " K"]  # entries of (d, a) that it leaves alone
    prior: float  # of the correlations, units' worth


def spread_view(data: Scaled, start: Spread, settings: PopulationSettings) -> View:
    """How to look at these units, from a spread."""
    correlations = np.arange(len(start.vector)) >= len(start.d)
    if len(data.x) >= ENOUGH * len(start.d) or np.any(data.tells.sum(axis=0) < 2):
        return View(data, start, np.zeros_like(correlations), settings.uncorrelated)
    return View(data.marginal, start.uncorrelated, correlations, 0.0)
