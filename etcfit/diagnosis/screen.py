"""Every candidate's signature in the residual, at the cost of one tangent each: the score test.

    gain = max_a |r|^2 - |r + C' a|^2,    C' = (1 - Q Q^T) dr/da

with a the amplitudes of an effect at its off value, within their bounds, and Q an orthonormal basis of the changes that
the fitted parameters can make to the residual. The shape parameters of an effect that is off have no tangent: each of
their `scan` values makes a separate variant. An amplitude that is scanned stays at its value a, with (r(a) - r(0))/a
in place of dr/da.

Source: Rao 1948 (score test); Chernoff 1954 for amplitudes on a bound. Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from ..model.parameters import AbstractDomain, NonNegative, Parameter
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .composition import Effect, resting
from .formula_errors import EXACT, FormulaErrors
from .tangents import (
    Tangents,
    Variant,
    fitted_samples,
    some_at_once,
)

_RIDGE = 1e-5  # ridge on amplitudes, their columns of length 1: keeps an amplitude at 0 that duplicates another


def lowest(domains: Sequence[AbstractDomain]) -> np.ndarray:
    """The lower bound of each amplitude over its scale, shape (k,): 0 or minus infinity."""
    return np.array([0.0 if isinstance(domain, NonNegative) else -np.inf for domain in domains])


def bounded(columns: np.ndarray, target: np.ndarray, low: np.ndarray) -> np.ndarray:
    """argmin |C a - t|^2 over a >= low, shape (k,).

    Args:
        columns: C, each of length 1, shape (n, k).
        target: t, shape (n,).
        low: shape (k,).
    """
    rows = np.vstack((columns, _RIDGE * np.eye(low.size)))
    right = np.concatenate((target, np.zeros(low.size)))
    return np.asarray(lsq_linear(rows, right, bounds=(low, np.inf), method="bvls").x)


RIGS_AT_ONCE = 16  # tangents of the rig in one kernel: more take long to compile, and much memory
IMITATED = 1e-6  # share of a signature's power below which fitted parameters imitate all of it
_TINY = 1e-10  # singular values below this share of 1 count as zero


@dataclass(frozen=True, eq=False)
class Signature:
    """The linearised change that a variant makes to the residual."""

    variant: Variant  # the variant of a candidate
    # d residual / d amplitude over its scale, projected off the fitted parameters, shape (n, k)
    columns: np.ndarray = field(repr=False)
    gain: float  # fall of chi2 by the linearised model
    values: Mapping[str, float]  # amplitudes (SI) at which chi2 is lowest, and the shape parameters, by symbol
    own: float  # share of the signature's power that no fitted parameter can imitate
    seen: int = 0  # how many of the amplitudes the residual shows at all

    def briefly(self) -> Signature:
        """The signature without its columns, which are as long as all samples."""
        return replace(self, columns=np.empty((0, self.columns.shape[1])))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """An orthonormal basis of what columns, shape (n, k), span; dependent columns add nothing."""
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    keep = values > _TINY
    return columns @ (vectors[:, keep] / np.sqrt(values[keep]))


@dataclass(frozen=True, eq=False)
class Background:
    """The residual of the fitted model and the space of changes that its parameters can make."""

    # residual of the fitted samples, whitened by the formula errors, projected off the parameters, shape (n,)
    r: np.ndarray
    basis: np.ndarray  # orthonormal basis of the changes by the parameters, shape (n, p), p <= P
    jacobian: np.ndarray  # of the residual in the parameters, not whitened by the formula errors, shape (n, P)
    errors: FormulaErrors = EXACT  # formula errors of the model

    @classmethod
    def of_model(
        cls, problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, errors: FormulaErrors = EXACT
    ) -> Background:
        """The background of a model at coordinates x, shape (P,)."""
        return cls.spanned(*fitted_samples(problem, x, weighted), errors)

    @classmethod
    def spanned(cls, r: np.ndarray, jacobian: np.ndarray, errors: FormulaErrors = EXACT) -> Background:
        """The background of a residual, shape (n,), and its Jacobian, shape (n, P); dependent columns add nothing."""
        basis = orthonormal(errors.whitened(jacobian))
        return cls(cls.free_of(basis, errors.whitened(r)), basis, jacobian, errors)

    @staticmethod
    def free_of(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(1 - Q Q^T) C of columns of shape (n,) or (n, k)."""
        return columns - basis @ (basis.T @ columns)

    def among(self, rows: np.ndarray, columns: np.ndarray) -> Own:
        """The contribution of columns to some samples alone.

        Args:
            rows: of the fitted samples, shape (m,).
            columns: of those samples, shape (m, k).
        """
        columns = self.errors.whitened(columns, rows)
        whole, imitated = np.sum(columns**2, axis=0), np.sum((self.basis[rows].T @ columns) ** 2, axis=0)
        own = whole - imitated
        return Own(self.r[rows] @ columns, np.where(own > IMITATED * whole, own, 0.0))

    def signature(self, variant: Variant, columns: np.ndarray, parameters: Mapping[str, Parameter]) -> Signature:
        """The score test of one variant.

        Args:
            columns: d residual / d amplitude over its scale, shape (n, k); what is not finite counts as 0.
            parameters: of the candidate, by symbol.
        """
        whole = self.errors.whitened(np.where(np.isfinite(columns), columns, 0.0))
        own = self.free_of(self.basis, whole)
        power, kept = np.sum(whole**2, axis=0), np.sum(own**2, axis=0)
        own = np.where(kept > IMITATED * power, own, 0.0)
        share = float(np.sum(own**2) / max(float(power.sum()), 1e-300))
        if share == 0.0:
            return Signature(variant, own, 0.0, {**variant.shape, **(variant.effect.off or {})}, 0.0)
        mine = [parameters[s] for s in variant.amplitudes]
        if any(s in variant.shape for s in variant.amplitudes):  # a secant holds for that value, not for smaller ones
            amplitudes = np.array([variant.shape[p.symbol] / p.domain.scale for p in mine])
            gain = max(float(self.r @ self.r - np.sum((self.r + own @ amplitudes) ** 2)), 0.0)
        else:
            amplitudes, gain = _bounded(mine, own, self.r)
        values = {p.symbol: a * p.domain.scale for p, a in zip(mine, amplitudes.tolist(), strict=True)}
        seen = int(np.sum(np.any(own != 0.0, axis=0)))
        return Signature(variant, own, gain, {**variant.shape, **values}, share, seen)


class Own(NamedTuple):
    """For columns c, from some samples alone: r c, and |c|^2 of the part that no parameter can imitate, 0 where that is
    negligible; shape (k,) each."""

    way: np.ndarray
    power: np.ndarray

    @property
    def gain(self) -> np.ndarray:
        """Fall of chi2 by each column alone, its amplitude free, shape (k,)."""
        return np.divide(self.way**2, self.power, out=np.zeros(self.way.size), where=self.power > 0.0)


def _bounded(mine: Sequence[Parameter], columns: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, float]:
    """Amplitudes over their scales that minimise |r + C a|^2 within their bounds, and the fall."""
    size = np.linalg.norm(columns, axis=0)
    own = size > 0.0  # an amplitude without a signature stays at its off value
    q, upper = np.linalg.qr(columns[:, own] / size[own])
    target = -(q.T @ r)
    solution = bounded(upper, target, lowest([p.domain for p in mine])[own])
    gain = float(target @ target - np.sum((upper @ solution - target) ** 2))
    amplitudes = np.zeros(own.size)
    amplitudes[own] = solution / size[own]
    return amplitudes, max(gain, 0.0)


def screen_of_the_rig(
    background: Background,
    tangents: Tangents,
    candidates: Sequence[Effect],
    kept: Callable[[Signature], Signature] = lambda whole: whole,
) -> list[Signature]:
    """The signature of every candidate that acts around the throttle.

    Their tangents are columns of the Jacobian of the lean model in which all of them are free; they are computed in
    groups.

    Args:
        tangents: tangents of the model with all these effects at work, at their off values.
    """
    layout, found = tangents.problem.layout, []
    parameters = {p.symbol: p for p in layout.parameters}
    every = [Variant(e, {}, tuple(s for s in resting(e) if s in layout.free)) for e in candidates]
    for few in some_at_once([v for v in every if v.amplitudes], RIGS_AT_ONCE):
        symbols = tuple(dict.fromkeys(s for v in few for s in v.amplitudes))
        slopes = tangents.together(symbols)
        for v in few:
            columns = np.stack([slopes[s] * parameters[s].domain.scale for s in v.amplitudes], axis=1)
            found.append(kept(background.signature(v, columns, parameters)))
    return found


def ranked(signatures: Sequence[Signature]) -> tuple[Signature, ...]:
    """The best variant of each effect, the largest gain first."""
    best: dict[Effect, Signature] = {}
    for signature in signatures:
        effect = signature.variant.effect
        if effect not in best or signature.gain > best[effect].gain:
            best[effect] = signature
    return tuple(sorted(best.values(), key=lambda s: -s.gain))
