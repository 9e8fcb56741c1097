"""Do traces, or tests, disagree by more than their noise, and how wide must the intervals be if they do?

    T_k = sum_g d_gk^2 / E[sum_g d_gk^2],    nu_k = (tr Q_k)^2 / tr Q_k^2

d_g is what leaving cluster g out moves, Q_k = cov(d_gk, d_hk) if the model is right and noise as `inflation` has it:
then nu_k T_k is nearly chi2 of nu_k degrees of freedom. A bench has few clusters to a parameter, nu_k about 2, and its
raw cluster covariance would be a number drawn at random; it counts only where T_k refuses agreement. There

    C' = C + W (sum_g d_g d_g^T) W,    C'_kk = phi_k (t_(1 + nu_k) / 1.96)^2 C_kk
    phi_k = (1 + nu_k T_k) / (1 + nu_k)

with W diagonal, and 0 for all other parameters. The 1 is one degree of freedom's worth of belief that noise is what it
is said to be: without it an interval of two clusters would be ten times as wide or not at all.

Source: Bell and McCaffrey 2002, Survey Methodology 28(2) (jackknife over clusters, degrees of freedom after
Satterthwaite); Birge 1932, Phys. Rev. 40 (T); Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3(1) (phi). Differs from
source: the variance under agreement is known here, so that it can be tested for, and nothing is ever narrowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from .statement import Split, Statement

_NORMAL = float(ndtri(0.975))
_BELIEVED = 1.0  # degrees of freedom


class Scatter(NamedTuple):
    """How the estimates scatter when clusters are left out one by one.

    Args:
        shifts: d, shape (G, P).
        ratio: T, shape (P,); 0 where a cluster alone determines the parameter, so that nothing can disagree.
        freedom: nu, shape (P,).
    """

    shifts: np.ndarray
    ratio: np.ndarray
    freedom: np.ndarray

    @property
    def p(self) -> np.ndarray:
        """Probability of such a scatter, or a larger one, where clusters agree, shape (P,)."""
        return np.asarray(chdtrc(self.freedom, self.ratio * self.freedom))


def scatter(clusters: Sequence[Statement], believed: Statement, reach: np.ndarray, unknown: float) -> Scatter:
    """Leave out every cluster once.

    Args:
        clusters: what each says; together all the data.
        believed: the priors.
        reach: of each coordinate, shape (P,).
        unknown: standard deviation above which a parameter is not known, reaches.
    """
    everything = reduce(add, clusters, believed)
    splits = [Split(own, everything - own, reach, unknown) for own in clusters]
    shifts = np.array([split.shift for split in splits])
    alone = np.any([split.lost_without for split in splits], axis=0)
    inverse = np.linalg.inv(everything.information)
    others = np.array([split.others_inverse for split in splits])
    spread = np.array([own.spread for own in clusters])
    expected, squares = np.zeros(reach.size), np.zeros(reach.size)
    for k in range(reach.size):
        q = _covariance(inverse[k], others[:, k], spread)
        expected[k], squares[k] = np.trace(q), np.sum(q**2)
    told = ~alone & (expected > 0.0)
    ratio = np.where(told, np.sum(shifts**2, axis=0) / np.where(told, expected, 1.0), 0.0)
    freedom = np.where(told, expected**2 / np.where(told, squares, 1.0), 1.0)
    return Scatter(shifts, ratio, np.maximum(1.0, freedom))


def _covariance(all_row: np.ndarray, without_rows: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Q_k, shape (G, G): shifts are d_g = sum_h (F^-1 - [h != g] F_(-g)^-1) s_h, and s_h has variance M_h.

    Args:
        all_row: k-th row of F^-1, shape (P,).
        without_rows: k-th row of each F_(-g)^-1, shape (G, P).
        spread: M of each cluster, shape (G, P, P).
    """
    count = len(spread)
    kept = 1.0 - np.eye(count)
    rows = all_row - kept[:, :, None] * without_rows[:, None, :]
    return np.einsum("ghp,hpq,fhq->gf", rows, spread, rows, optimize=True)


def widened(covariance: np.ndarray, every: Iterable[Scatter], level: float) -> np.ndarray:
    """The covariance that clusters which disagree leave, shape (P, P); never narrower, not even a combination.

    Args:
        covariance: C, shape (P, P).
        every: the scatter over traces, over tests: the wider one counts for each parameter.
        level: of the test for agreement.
    """
    wide = covariance
    for each in every:
        freedom = _BELIEVED + each.freedom
        growth = (_BELIEVED + each.freedom * each.ratio) / freedom * (stdtrit(freedom, 0.975) / _NORMAL) ** 2
        target = np.where(each.p < level, np.maximum(growth, 1.0), 1.0) * np.diag(covariance)
        lack = np.maximum(target - np.diag(wide), 0.0)
        own = np.sum(each.shifts**2, axis=0)
        weight = np.sqrt(np.where(own > 0.0, lack / np.where(own > 0.0, own, 1.0), 0.0))
        scaled = each.shifts * weight
        wide = wide + scaled.T @ scaled
    return wide
