"""Contributions of channels, traces and tests to the normal equations, and the comparison of two of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import repeat
from operator import add
from typing import NamedTuple

import numpy as np

from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .goodness import inflation

# ---- The residual of a fit channel by channel: each channel can be weighted, left out, or evaluated alone


class Piece(NamedTuple):
    """The logged samples of one channel of one trace."""

    # test, file: its rig test and file
    test: str
    file: str
    jacobian: np.ndarray  # Jacobian of the whitened residual in the coordinates, shape (n, P)
    r: np.ndarray  # whitened residual, shape (n,)
    discount: float = 1.0  # assumed error of a sample in times its noise, for a model far from the data; else 1

    def residual_after(self, step: np.ndarray) -> np.ndarray:
        """r + J step: the residual after a step of the coordinates, shape (P,), to first order."""
        return self.r + self.jacobian @ step

    def misfit(self, step: np.ndarray | None = None) -> float:
        """Sum of squared residuals over the noise itself, after a step if one is given."""
        return self.discount**2 * float(np.sum((self.r if step is None else self.residual_after(step)) ** 2))


def pieces_at(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> tuple[Piece, ...]:
    """Every channel of every trace."""
    out = []
    every = zip(problem.batch.traces, problem.batch.places, problem.linearise_traces(x, weighted), strict=True)
    for trace, (lane, _, marks), (r, columns) in every:
        for m in range(len(trace.channels)):
            seen = np.isfinite(trace.data[:, m])
            where = trace.test.name, trace.measurement.file
            discount = float(np.median(problem.sigma[marks[seen], lane, m])) / float(trace.sigma[m])
            own = columns[m] if seen.all() else columns[m][seen]
            out.append(Piece(*where, own, r[seen, m], discount))
    return tuple(out)


def whitened(problem: EstimationProblem, pieces: Iterable[Piece]) -> tuple[np.ndarray, ...]:
    """The residual of each trace, shape (n, M) each; 0 where nothing was logged."""
    each, out = iter(pieces), []
    for trace in problem.batch.traces:
        seen = np.isfinite(trace.data)
        r = np.zeros(seen.shape)
        for m in range(len(trace.channels)):
            r[seen[:, m], m] = next(each).r
        out.append(r)
    return tuple(out)


def information_in(
    pieces: Iterable[Piece], prior_sd: np.ndarray, inflations: Iterable[float] = repeat(1.0)
) -> np.ndarray:
    """sum J^T J / f of pieces, f the inflations, and the information of the user's priors, shape (P, P)."""
    total = np.diag(1.0 / np.asarray(prior_sd) ** 2)
    for piece, f in zip(pieces, inflations, strict=False):
        total = total + piece.jacobian.T @ piece.jacobian / f
    return total


# ---- The contribution of a part of the data, and the directions in which it can be compared with another part
#
#     F = J^T J,    s = J^T r,    M = sum_c f_c J_c^T J_c,    f_c as in `goodness.inflation`
#
# F and s are a part's share of the normal equations, M is the variance of s if residuals are larger than their noise
# or not independent. Two parts, own and others, are compared in directions b_i with
#
#     b_i^T (F_own + F_others) b_j = delta_ij,    b_i^T F_own b_j = lambda_i delta_ij
#
# in which each part's own estimate is one step: -sum_i b_i (b_i^T s_own) / lambda_i, and with 1 - lambda_i for the
# others.
#
# Source: Belsley, Kuh and Welsch 1980, Regression Diagnostics, ch. 2 (leaving out); Hausman 1978, Econometrica 46(6).
# Differs from source: groups of rows are left out, not single ones; each direction is judged separately.


@dataclass(frozen=True, eq=False)
class Statement:
    """The contribution of a part of the data to the normal equations."""

    information: np.ndarray  # F, shape (P, P)
    score: np.ndarray  # s, shape (P,)
    spread: np.ndarray  # M, shape (P, P)
    samples: float  # number of independent samples, sum of n / f; 0 for a prior

    def __add__(self, other: Statement) -> Statement:
        return Statement(
            self.information + other.information,
            self.score + other.score,
            self.spread + other.spread,
            self.samples + other.samples,
        )

    def __sub__(self, other: Statement) -> Statement:
        return Statement(
            self.information - other.information,
            self.score - other.score,
            self.spread - other.spread,
            self.samples - other.samples,
        )


def prior(information: np.ndarray, score: np.ndarray) -> Statement:
    """The contribution of the priors.

    Args:
        information: inverse of the priors' covariance, shape (P, P).
        score: information times (x - mean), shape (P,).
    """
    return Statement(information, score, information, 0.0)


def statement(pieces: Iterable[Piece], inflations: Iterable[float]) -> Statement:
    """The joint contribution of some channels, at least one."""
    return reduce(add, (_of_one(piece, f) for piece, f in zip(pieces, inflations, strict=True)))


def _of_one(piece: Piece, f: float) -> Statement:
    information = piece.jacobian.T @ piece.jacobian
    return Statement(information, piece.jacobian.T @ piece.r, f * information, piece.r.size / f)


def inflations_of(pieces: Iterable[Piece], step: np.ndarray | None = None) -> list[float]:
    """f of each channel, after a step of the coordinates, shape (P,), if one is given."""
    return [inflation(p.r if step is None else p.residual_after(step)) for p in pieces]


@dataclass(frozen=True, eq=False)
class Split:
    """Two parts of the data, compared."""

    own: Statement  # statement of one part
    others: Statement  # statement of all the rest, priors included
    reach: np.ndarray  # reach of each coordinate, shape (P,)
    unknown: float  # standard deviation above which a direction or a parameter counts as not determined, reaches

    @cached_property
    def _decomposed(self) -> tuple[np.ndarray, np.ndarray]:
        """lambda, shape (P,), rising, and the directions b as columns, shape (P, P)."""
        F = self.own.information + self.others.information
        scale = 1.0 / np.sqrt(np.diag(F))  # so that coordinates of any size have equal rounding errors
        power, ways = np.linalg.eigh(F * np.outer(scale, scale))
        # two coordinates with the same effect leave only rounding errors, of either sign, in one direction
        root = (ways / np.sqrt(np.maximum(power, scale.size * np.finfo(float).eps * power[-1]))).T
        share, vectors = np.linalg.eigh(root @ (self.own.information * np.outer(scale, scale)) @ root.T)
        return np.clip(share, 0.0, 1.0), scale[:, None] * (root.T @ vectors)

    @property
    def share(self) -> np.ndarray:
        """lambda of each direction: the own part's share of the information, shape (P,)."""
        return self._decomposed[0]

    @property
    def directions(self) -> np.ndarray:
        """Columns b_i, shape (P, P)."""
        return self._decomposed[1]

    @cached_property
    def others_share(self) -> np.ndarray:
        """1 - lambda, the others' share, shape (P,), accurate even if small."""
        b = self.directions
        return np.maximum(np.einsum("pi,pq,qi->i", b, self.others.information, b), 1e-200)

    @cached_property
    def determined_by_own(self) -> np.ndarray:
        """Directions that the own part determines, shape (P,) of bool."""
        return self._width < self.unknown * np.sqrt(self.share)

    @cached_property
    def determined_by_others(self) -> np.ndarray:
        """Directions that the others determine, shape (P,) of bool."""
        return self._width < self.unknown * np.sqrt(self.others_share)

    @property
    def _width(self) -> np.ndarray:
        """Standard deviation along each direction with all the data, reaches, shape (P,)."""
        return np.max(np.abs(self.directions) / self.reach[:, None], axis=0)

    @property
    def own_inverse(self) -> np.ndarray:
        """Inverse of the own information in the directions that it determines, shape (P, P)."""
        return self._inverse(self.determined_by_own, self.share)

    @property
    def others_inverse(self) -> np.ndarray:
        """Inverse of the others' information in the directions that they determine, shape (P, P)."""
        return self._inverse(self.determined_by_others, self.others_share)

    def _inverse(self, determined: np.ndarray, information: np.ndarray) -> np.ndarray:
        b = self.directions[:, determined]
        return (b / information[determined]) @ b.T

    @property
    def lost_without(self) -> np.ndarray:
        """Parameters that are not known without the own part, shape (P,) of bool."""
        variance = np.sum(self.directions**2 / self.others_share, axis=1)
        return np.sqrt(variance) > self.unknown * self.reach

    @property
    def own_step(self) -> np.ndarray:
        """The step to the own part's estimate, shape (P,); 0 in directions that it does not determine."""
        return -self.own_inverse @ self.own.score

    @property
    def others_step(self) -> np.ndarray:
        """The step to the others' estimate, shape (P,); 0 in directions that they do not determine."""
        return -self.others_inverse @ self.others.score

    @property
    def shift(self) -> np.ndarray:
        """The shift when the own part is left out: the others' estimate minus that of all, one step each, shape (P,); 0
        in directions that the others do not determine."""
        b, determined = self.directions, self.determined_by_others
        others, together = b.T @ self.others.score, b.T @ (self.own.score + self.others.score)
        return b[:, determined] @ (together - others / self.others_share)[determined]
