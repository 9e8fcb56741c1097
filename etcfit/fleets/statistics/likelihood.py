"""How well a covariance between units agrees with their estimates, their own uncertainty taken into account.

    estimate_u = theta_u + e_u,   theta_u ~ N(mu, Omega),   e_u ~ N(0, F_u^-1),   F_u = H_u^T H_u
    M_u = I + H_u Omega H_u^T,   W_u = H_u^T M_u^-1 H_u  (= (F_u^-1 + Omega)^-1 where F_u is regular)
    mu = (sum W_u)^-1 sum W_u x_u
    -2 log L = sum log|M_u| + sum e_u^T M_u^-1 e_u + log|sum W_u|,   e_u = H_u (x_u - mu)

The last term makes it restricted (REML): the spread is not estimated low because the mean was taken from the same few
units. A prior of nu uncorrelated units' worth, -nu log|R| of the correlation matrix R, keeps correlations off +-1 where
units are few, and is lost in the data where they are many. What standard deviations take of it says `spread_view`.

Source: Laird and Ware 1982 (Biometrics 38), eqs. 3.2-3.5; Harville 1977 (JASA 72). Differs from source: information
instead of design matrices; the prior is that of Lewandowski, Kurowicka and Joe 2009; Fisher scoring instead of EM,
which takes thousands of steps where a spread is near zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from .scaled import Scaled
from .settings import PopulationSettings
from .spread import Spread


@dataclass(frozen=True, eq=False)
class Weighed:
    """Units under one covariance between them.

    Args:
        value: -2 log L, restricted, prior included.
        mean: mu, shape (P,).
        mean_covariance: (sum W)^-1, shape (P, P).
        weight: W, shape (N, P, P).
        pull: W (x - mu), shape (N, P).
    """

    value: float
    mean: Float[np.ndarray, " P"]
    mean_covariance: Float[np.ndarray, "P P"]
    weight: Float[np.ndarray, "N P P"]
    pull: Float[np.ndarray, "N P"]


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


def slope(at: Weighed, spread: Spread, prior: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (K,) and expected Hessian (K, K) of -2 log L in (d, a).

    d(-2 log L) = sum tr[(W - r r^T - W C W) dOmega],   E Hessian_kl = sum tr(W E_k W E_l),   C = (sum W)^-1
    """
    own, size = spread.own, int(spread.own.sum())
    count, all_symbols = at.pull.shape
    lifted = at.weight @ at.mean_covariance
    beside = np.swapaxes(lifted, 0, 1).reshape(all_symbols, -1)  # (i, u j)
    doubled = beside @ at.weight.reshape(-1, all_symbols)  # sum W C W
    g = at.weight.sum(axis=0) - at.pull.T @ at.pull - doubled
    e = spread.slopes
    gradient = np.einsum("kij,ij->k", e, 0.5 * (g + g.T)[np.ix_(own, own)])
    flat = at.weight[:, own][:, :, own].reshape(count, size * size)
    four = (flat.T @ flat).reshape(size, size, size, size)  # sum W_ab W_cd
    turned = four.transpose(1, 2, 3, 0).reshape(size * size, size * size)  # (bc), (da)
    columns = e.reshape(len(e), size * size)
    swapped = np.swapaxes(e, 1, 2).reshape(len(e), size * size)
    hessian = columns @ turned @ swapped.T
    row, _ = np.tril_indices(size, -1)
    long = np.diag(spread.rows)[row] ** -2
    gradient[size:] += 2.0 * prior * spread.a / long
    hessian[np.diag_indices(len(e))] += np.concatenate([np.zeros(size), 2.0 * prior / long])
    return gradient, 0.5 * (hessian + hessian.T)


def maximised(
    data: Scaled, start: Spread, settings: PopulationSettings, held: Bool[np.ndarray, " K"], prior: float = 0.0
) -> Spread:
    """The covariance of highest restricted likelihood: quasi-Newton in coordinates whose expected Hessian is one.

    With many units the expected Hessian is the true one, and a step or two is enough; with few, BFGS learns the rest.

    Args:
        data: units.
        start: with d > 0 in what shall move: at nought the slope is always nought.
        settings: steps, tolerance.
        held: entries of (d, a) that stay.
        prior: of the correlations, units' worth.
    """
    if np.all(held):
        return start
    free, origin = np.flatnonzero(~held), start.vector
    _, hessian = slope(weigh(data, start, prior), start, prior)
    h = hessian[np.ix_(free, free)]
    root = np.linalg.cholesky(h + np.diag(1e-3 * np.diag(h) + 1e-9 * (1.0 + np.max(np.diag(h)))))

    def spread(z: np.ndarray) -> Spread:
        vector = origin.copy()
        vector[free] += np.linalg.solve(root.T, z)
        return start.at(vector)

    def value(z: np.ndarray) -> tuple[float, np.ndarray]:
        tried = spread(z)
        here = weigh(data, tried, prior)
        return here.value, np.linalg.solve(root, slope(here, tried, prior)[0][free])

    nearly = float(np.sqrt(2.0 * settings.tolerance / len(free)))
    options = {"gtol": nearly, "maxiter": settings.steps}
    return upright(spread(minimize(value, np.zeros(len(free)), jac=True, method="BFGS", options=options).x))


def upright(spread: Spread) -> Spread:
    """The same covariance with no d below nought: a pair of signs is a correlation's sign."""
    sign = np.where(spread.d < 0.0, -1.0, 1.0)
    row, column = np.tril_indices(len(spread.d), -1)
    return Spread(spread.own, np.abs(spread.d), spread.a * sign[row] * sign[column])
