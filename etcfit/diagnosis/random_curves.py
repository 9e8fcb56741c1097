"""Random curves: what they leave in the residual, and how far they may have moved the parameters.

    r = e + J dx + sum_c T_c a_c,    a_c ~ N(0, tau_c^2 K),    K_kl = exp(-|k - l| / l_K)

e is noise, T_c the derivative of the residual in the amplitudes of a smooth curve, a_c a Gaussian process over its
knots. The residual r shows only the part of T_c that no parameter can imitate: from it every tau_c is estimated. With
tau known, the part that parameters imitate, and the distance by which it moved them, have a known size too,

    C' = C + (t_nu / 1.96)^2 ([cov(dx | r) - (J^T J + P_0)^-1] + dx dx^T)

dx is the step to the optimum with curves in addition to the parameters, nu the number of amplitudes that determine
tau; the fit itself stays at the optimum without curves. Where the residual is noise every tau is 0, and so is the
added covariance.

Source: Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63(3) (model discrepancy); Patterson and Thompson 1971,
Biometrika 58(3) (restricted likelihood); Simpson et al. 2017, Stat. Sci. 32(1) (prior of tau). Differs from source:
one event alone is no evidence for a curve; the estimate is not moved, but its interval is widened by the movement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, optimize
from scipy.special import ndtri, stdtrit

from ..model.parameters import parameters_of
from ..model.smooth import AbstractSmooth
from .screen import Background

CURVE_LENGTH = 3.0  # knots over which a random curve is correlated
# rise of -2 log L without random curves, one event left out, from which on they are taken to be present
CURVE_EVIDENCE = 10.0
LARGE_CURVE = 0.05  # prior probability that a random curve is larger than the typical size of the term that it enters
CURVE_STRETCHES = 20  # equal parts of a trace, one of which counts as one event
_RANK = 1e-8  # singular values below this share of the largest count as zero
_LARGEST = 1e3  # tau over a curve's typical size: upper bound of the search


@dataclass(frozen=True, eq=False)
class Curve:
    """One smooth curve and its derivative of the residual."""

    effect: type[AbstractSmooth]  # the curve as an effect
    columns: np.ndarray = field(repr=False)  # T, d residual / d amplitude over its scale, shape (n, K)

    @property
    def scale(self) -> float:
        """The size that tau = 1 means, in the curve's unit."""
        return parameters_of(self.effect)[0].domain.scale


@dataclass(frozen=True, eq=False)
class CurveDiscrepancy:
    """How large each random curve is, and how far the curves may have moved the coordinates."""

    sizes: Mapping[type[AbstractSmooth], float]  # tau of each curve that is present, in the curve's unit
    covariance: np.ndarray = field(repr=False)  # covariance to be added to that of the coordinates, shape (P, P)


def curve_discrepancy(
    r: np.ndarray,
    jacobian: np.ndarray,
    believed: np.ndarray,
    curves: Sequence[Curve],
    events: np.ndarray,
) -> CurveDiscrepancy:
    """Estimate every tau, and the covariance that the curves cause.

    Args:
        r: whitened residual at the optimum, shape (n,).
        jacobian: of it, shape (n, P).
        believed: information of the priors, shape (P, P).
        events: number of the stretch of a trace that each sample lies in, shape (n,).
    """
    none = CurveDiscrepancy({}, np.zeros_like(believed))
    if not any(c.columns.any() for c in curves):
        return none
    background = Background.spanned(r, jacobian)
    root = np.linalg.cholesky(kernel(curves[0].columns.shape[1], CURVE_LENGTH))
    ways = np.empty((r.size, len(curves) * len(root)))
    for c, own in zip(curves, np.split(ways, len(curves), axis=1), strict=True):
        np.matmul(c.columns, root, out=own)
    left = _Left.of_residual(background, background.free_of(background.basis, ways), len(curves), events)
    tau = most_likely(left)
    if not tau.any():
        return none
    sizes = {c.effect: float(t) * c.scale for c, t in zip(curves, tau, strict=True) if t > 0.0}
    freedom, noise = left.freedom(tau), left.noise
    del left
    ways *= np.repeat(tau, len(root))
    return CurveDiscrepancy(
        sizes, t_to_normal_ratio(freedom) ** 2 * moved_by_curves(r, jacobian, believed, ways, noise)
    )


def t_to_normal_ratio(freedom: float) -> float:
    """t_nu / 1.96, 95 % of both: a tau from nu visible amplitudes is itself uncertain; nu counts as 2 at least."""
    return float(stdtrit(max(freedom, 2.0), 0.975) / ndtri(0.975))


def kernel(count: int, length: float) -> np.ndarray:
    """K_kl = exp(-|k - l| / length), shape (count, count): a rough process, because the missing curve may have
    corners."""
    k = np.arange(count)
    return np.exp(-np.abs(k[:, None] - k[None, :]) / length)


def moved_by_curves(
    r: np.ndarray, jacobian: np.ndarray, believed: np.ndarray, ways: np.ndarray, noise: float
) -> np.ndarray:
    """Mean square of the movement of the coordinates by the curves, given the data, shape (P, P).

        [J^T J + P_0   J^T W    ] [dx]     [J^T r]
        [W^T J         W^T W + 1] [b ] = - [W^T r],    cov(dx) - (J^T J + P_0)^-1 + dx dx^T

    Args:
        r, jacobian, believed: as of `curve_discrepancy`.
        ways: W, sqrt(tau^2 K) of all curves side by side, shape (n, m): their amplitudes b are of unit variance.
        noise: s^2.
    """
    alone = jacobian.T @ jacobian / noise + believed
    across, own = jacobian.T @ ways / noise, ways.T @ ways / noise + np.eye(ways.shape[1])
    inverse = np.linalg.inv(alone - across @ np.linalg.solve(own, across.T))
    by = inverse @ (across @ np.linalg.solve(own, ways.T @ r) - jacobian.T @ r) / noise
    return inverse - np.linalg.inv(alone) + np.outer(by, by)


@dataclass(frozen=True, eq=False)
class _Left:
    """The residual and the curves' columns, both projected off the parameters. The columns W of all curves are as long
    as all samples, so there is one copy of them; everything else is computed from their products.
    """

    r: np.ndarray  # residual, projected off the parameters, shape (n,)
    ways: np.ndarray  # W of all curves side by side, projected likewise, shape (n, C K)
    curves: int  # C, number of curves
    events: np.ndarray  # see `curve_discrepancy`
    gram: np.ndarray  # W^T W, shape (C K, C K)
    across: np.ndarray  # W^T r, shape (C K,)
    turn: np.ndarray  # W @ turn is an orthonormal basis of the space that all W span, shape (C K, m)
    noise: float  # s^2, mean square of r outside that space, 1 at least

    @classmethod
    def of_residual(cls, background: Background, ways: np.ndarray, curves: int, events: np.ndarray) -> _Left:
        r, gram, across = background.r, ways.T @ ways, ways.T @ background.r
        values, vectors = np.linalg.eigh(gram)
        keep = values > _RANK * max(float(values[-1]), 1e-300)
        turn = vectors[:, keep] / np.sqrt(values[keep])
        y = turn.T @ across
        rest = max(r.size - background.basis.shape[1] - y.size, 1)
        noise = max(1.0, float(r @ r - y @ y) / rest)
        return cls(r, ways, curves, events, gram, across, turn, noise)

    def freedom(self, tau: np.ndarray) -> float:
        """tr G (G + 1)^-1, G = tau^2 W^T W / s^2 of all curves: how many of their amplitudes stand out of the noise."""
        power = np.maximum(np.linalg.eigvalsh(self._system(tau)), 0.0)
        return float(np.sum(power / (power + 1.0)))

    def by_event(self, tau: np.ndarray) -> np.ndarray:
        """Fall of chi2 that all curves at their likeliest amplitudes make in each event."""
        size, system = self._sizes(tau), self._system(tau) + np.eye(self.across.size)
        with_them = self.r - self.ways @ (size * np.linalg.solve(system, size * self.across / self.noise))
        return np.bincount(self.events, self.r**2 - with_them**2) / self.noise

    def _sizes(self, tau: np.ndarray) -> np.ndarray:
        return np.repeat(tau, self.across.size // self.curves)

    def _system(self, tau: np.ndarray) -> np.ndarray:
        size = self._sizes(tau)
        return size[:, None] * self.gram * size / self.noise


def most_likely(left: _Left) -> np.ndarray:
    """tau of each curve by restricted maximum likelihood, shape (C,).

    All are 0 where -2 ln L without curves is higher by less than `CURVE_EVIDENCE`, not counting the event in which they
    explain most. It is not decided which curve it is: curves over related axes share what each of them can explain.
    """
    system = _Likelihood.of_residual(left, -2.0 * np.log(LARGE_CURVE))
    tau, cost = system.fitted()
    one_event = max(0.0, float(np.max(left.by_event(tau), initial=0.0)))
    needed = float(system.y @ system.y) - cost - one_event
    return tau if needed > CURVE_EVIDENCE else np.zeros_like(tau)


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """-2 ln (L p) = ln |V| + y^T V^-1 y + price sum_c tau_c,    V = 1 + sum_c tau_c^2 U_c

    The prior keeps a tau small that the data hardly determine.
    """

    y: np.ndarray  # residual in the curves' space, over s, shape (m,)
    units: np.ndarray  # U_c = W_c W_c^T there, over s^2, shape (C, m, m)
    price: float  # of a curve of its typical size in -2 ln p

    @classmethod
    def of_residual(cls, left: _Left, price: float) -> _Likelihood:
        each = np.split(left.turn.T @ left.gram, left.curves, axis=1)
        units = np.stack([w @ w.T / left.noise for w in each])
        return cls(left.turn.T @ left.across / np.sqrt(left.noise), units, price)

    def fitted(self) -> tuple[np.ndarray, float]:
        """tau where the cost is least, and the cost there."""
        power = np.maximum(np.trace(self.units, axis1=1, axis2=2), 1e-300)
        start = np.minimum(np.sqrt(max(float(self.y @ self.y), 1.0) / (len(power) * power)), 1.0)
        bounds = [(0.0, _LARGEST)] * start.size
        found = optimize.minimize(self._cost, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return found.x, float(found.fun)

    def _cost(self, tau: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient."""
        factor = linalg.cho_factor(np.eye(self.y.size) + np.tensordot(tau**2, self.units, 1), lower=True)
        solved, inverse = linalg.cho_solve(factor, self.y), linalg.cho_solve(factor, np.eye(self.y.size))
        value = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) + float(self.y @ solved)
        slope = np.tensordot(self.units, inverse - np.outer(solved, solved), 2)
        return value + self.price * float(tau.sum()), 2.0 * tau * slope + self.price
