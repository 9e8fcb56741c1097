"""Every candidate's signature in the residual, for the price of one tangent each: the score test.

    gain = max_a |r|^2 - |r + C' a|^2,    C' = (1 - Q Q^T) dr/da

with a the amplitudes of an effect at its off value, bounded where they are, and Q an orthonormal basis of what the
fitted parameters can do to the residual. The shape parameters of an effect that is off have no tangent: each of their
`scan` values makes a variant of its own. An amplitude that is scanned stays at its value a, with (r(a) - r(0))/a in
place of dr/da.

Source: Rao 1948 (score test); Chernoff 1954 for amplitudes on a bound. Differs from source: no.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from ..kernels.machine import available
from ..model.parameters import AbstractDomain, NonNegative, Parameter
from ..problem import residual_kernels
from ..problem.cores import side_by_side
from ..problem.free_parameters import Form
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, residual
from .bounded import bounded, lowest
from .composition import Effect, resting

# numerics, no policy: a step, a memory bound, and what counts as zero in double precision
_PROBE = 1e-3  # amplitude over its scale at which a tangent is taken: on a bound of 0 it may not exist
AT_ONCE = 8  # tangents side by side
RIGS_AT_ONCE = 16  # tangents of the rig in one kernel: more take long to compile, and much memory
_TOGETHER = 128  # most effects times tangents of one model
_IMITATED = 1e-6  # share of a signature's power below which fitted parameters do all of it
_TINY = 1e-10  # singular values below this share of 1 count as zero


@dataclass(frozen=True, eq=False)
class Variant:
    """One candidate with one choice of its shape.

    Args:
        effect: the candidate.
        shape: shape parameters, and amplitudes that are scanned, SI by symbol.
        amplitudes: symbols.
    """

    effect: Effect
    shape: Mapping[str, float]
    amplitudes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Signature:
    """What a variant would do to the residual.

    Args:
        variant: of which candidate.
        columns: d residual / d amplitude over its scale, free of what the fitted parameters can do, shape (n, k).
        gain: by how much it would lower chi2, by the linearised model.
        values: amplitudes (SI) at which it would, and its shape, by symbol.
        own: share of the signature's power that no fitted parameter can imitate.
        seen: how many of the amplitudes the residual shows at all.
    """

    variant: Variant
    columns: np.ndarray = field(repr=False)
    gain: float
    values: Mapping[str, float]
    own: float
    seen: int = 0

    def briefly(self) -> Signature:
        """Without its columns, which are as long as all samples."""
        return replace(self, columns=np.empty((0, self.columns.shape[1])))


def variants(effect: Effect) -> tuple[Variant, ...]:
    """A candidate at every combination of its `scan` values; other shapes nominal."""
    rest, off = resting(effect), effect.off or {}
    shape = {s: v for s, v in rest.items() if s not in off}
    grid = itertools.product(*effect.scan.values())
    return tuple(Variant(effect, shape | dict(zip(effect.scan, point, strict=True)), tuple(off)) for point in grid)


def in_groups(effects: Sequence[Effect]) -> list[tuple[Effect, ...]]:
    """Effects that are screened in one model: few enough for what its tangents cost, and alike in delaying signals and
    in whether they need tangents.

    A tangent costs about as much as there are effects in the model that it is taken in, so those with many variants go
    by themselves or nearly; but each model is a program to compile. The path has to be kept where anything delays.
    """
    groups: list[tuple[Effect, ...]] = []
    for effect in sorted(effects, key=lambda e: (*_kind(e), -_tangents_of(e))):
        last = groups[-1] if groups else ()
        together = (*last, effect)
        cost = len(together) * sum(map(_tangents_of, together))
        if last and _kind(last[0]) == _kind(effect) and cost <= _TOGETHER:
            groups[-1] = together
        else:
            groups.append((effect,))
    return groups


def _tangents_of(effect: Effect) -> int:
    """How many tangents it takes to screen an effect."""
    return sum(len(variant.amplitudes) for variant in variants(effect))


def _kind(effect: Effect) -> tuple[bool, bool]:
    """Whether it delays, and whether all its amplitudes are scanned."""
    return effect.delays, set(effect.off or {}) <= set(effect.scan)


@partial(jax.jit, static_argnums=0)
def _residuals(form: Form, x: Any, weighted: WeightedData, fulls: Any) -> Any:
    """Residual at K sets of values, (K, Q) -> (K, T, L, M)."""
    return jax.vmap(lambda full: residual(form, x, weighted._replace(pick=weighted.pick._replace(full=full))))(fulls)


@partial(jax.jit, static_argnums=0)
def _tangents(form: Form, x: Any, weighted: WeightedData, fulls: Any, ways: Any) -> Any:
    """Residual at K sets of values, and its derivative along K directions, (K, Q) each -> (K, T, L, M) each."""

    def one(full: Any, way: Any) -> Any:
        def shifted(e: Any) -> Any:
            pick = weighted.pick._replace(full=full + e * way)
            return residual(form, x, weighted._replace(pick=pick))

        return jax.jvp(shifted, (0.0,), (1.0,))

    return jax.vmap(one)(fulls, ways)


def tangents(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, every: Sequence[Variant]
) -> list[np.ndarray]:
    """For each variant the derivative of the fitted samples' residual in each amplitude over its scale, (n, k)."""
    layout = problem.layout
    fulls, ways = _directions(problem, np.array(weighted.pick.full, dtype=float), every)
    seen, padded = np.asarray(weighted.slots.weight) > 0.0, layout.padded(x)

    def one(full: np.ndarray, way: np.ndarray) -> np.ndarray:
        """The derivative along the way; the residual where there is none."""
        at = layout.form.full(padded, weighted.pick._replace(full=full))
        if not way.any():
            return np.asarray(residual_kernels.compared(layout.form, at, weighted).r)[seen]
        (k,) = np.flatnonzero(way)
        by = (layout.parameters[k].symbol,)
        return residual_kernels.linearised(layout.form, at, weighted, by)[1][seen, 0] * way[k]

    def some(k: int) -> list[np.ndarray]:
        few = slice(k, k + AT_ONCE)
        if available():
            return list(map(one, fulls[few], ways[few]))
        if not ways.any():
            return [r[seen] for r in np.asarray(_residuals(layout.form, padded, weighted, fulls[few]))]
        both = map(np.asarray, _tangents(layout.form, padded, weighted, fulls[few], ways[few]))
        return [(t if way.any() else r)[seen] for r, t, way in zip(*both, ways[few], strict=True)]

    base, *each = (one for few in side_by_side(some, range(0, len(fulls), AT_ONCE)) for one in few)
    found = iter(each)

    def column(variant: Variant, symbol: str) -> np.ndarray:
        if symbol not in variant.shape:
            return next(found)
        return (next(found) - base) * layout.parameter(symbol).domain.scale / variant.shape[symbol]

    return [np.stack([column(v, symbol) for symbol in v.amplitudes], axis=1) for v in every]


def off_its_bound(domain: AbstractDomain) -> float:
    """How far off its off value an amplitude is differentiated, over its scale: 0 where it may have either sign."""
    return _PROBE if isinstance(domain, NonNegative) else 0.0


class _Directions(NamedTuple):
    """Sets of all values, and directions in which the residual is differentiated there, 0 where it is asked for itself;
    shape (K, Q) each."""

    fulls: np.ndarray
    ways: np.ndarray


def _directions(problem: EstimationProblem, rest: np.ndarray, every: Sequence[Variant]) -> _Directions:
    """The model at rest first, then one row for each amplitude of each variant; padded to whole batches.

    Args:
        problem: of the composed model.
        rest: all its values with every candidate off, shape (Q,).
        every: variants.
    """
    layout, index = problem.layout, problem.layout.form.index
    fulls, ways = [rest], [np.zeros(rest.size)]
    for variant in every:
        full = rest.copy()
        for symbol, value in variant.shape.items():
            full[index[symbol]] = value
        for symbol in variant.amplitudes:
            domain, way = layout.parameter(symbol).domain, np.zeros(full.size)
            way[index[symbol]] = domain.scale
            fulls.append(full if symbol in variant.shape else full + way * off_its_bound(domain))
            ways.append(np.zeros(full.size) if symbol in variant.shape else way)
    padding = -len(fulls) % AT_ONCE
    return _Directions(np.stack(fulls + [fulls[-1]] * padding), np.stack(ways + [ways[-1]] * padding))


def fitted_samples(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> tuple[np.ndarray, np.ndarray]:
    """Residual of the fitted samples, shape (n,), and its Jacobian, shape (n, P), at coordinates x, shape (P,)."""
    r, _, jacobian = problem.linearise(x, weighted)
    seen = np.asarray(weighted.slots.weight) > 0.0
    return r[seen], jacobian[seen]


@dataclass(frozen=True, eq=False)
class Background:
    """The residual of the fitted model and all that its parameters can do to it.

    Args:
        r: residual of the fitted samples, free of what the parameters can do, shape (n,).
        basis: of what they can do, orthonormal, shape (n, p), p <= P.
        jacobian: of the residual in the parameters, shape (n, P).
    """

    r: np.ndarray
    basis: np.ndarray
    jacobian: np.ndarray

    @classmethod
    def of(cls, problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> Background:
        """That of a model at coordinates x, shape (P,)."""
        return cls.spanned(*fitted_samples(problem, x, weighted))

    @classmethod
    def spanned(cls, r: np.ndarray, jacobian: np.ndarray) -> Background:
        """That of a residual, shape (n,), and its Jacobian, shape (n, P); columns that depend on others add nothing."""
        columns = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        values, vectors = np.linalg.eigh(columns.T @ columns)
        keep = values > _TINY
        basis = columns @ (vectors[:, keep] / np.sqrt(values[keep]))
        return cls(cls.free_of(basis, r), basis, jacobian)

    @staticmethod
    def free_of(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(1 - Q Q^T) C of columns of shape (n,) or (n, k)."""
        return columns - basis @ (basis.T @ columns)

    def among(self, rows: np.ndarray, columns: np.ndarray) -> Own:
        """What columns do to some samples alone.

        Args:
            rows: of the fitted samples, shape (m,).
            columns: of those samples, shape (m, k).
        """
        whole, imitated = np.sum(columns**2, axis=0), np.sum((self.basis[rows].T @ columns) ** 2, axis=0)
        own = whole - imitated
        return Own(self.r[rows] @ columns, np.where(own > _IMITATED * whole, own, 0.0))

    def signature(self, variant: Variant, columns: np.ndarray, parameters: Mapping[str, Parameter]) -> Signature:
        """The score test of one variant.

        Args:
            variant: of a candidate.
            columns: d residual / d amplitude over its scale, shape (n, k); what is not finite counts as 0.
            parameters: of the candidate, by symbol.
        """
        whole = np.where(np.isfinite(columns), columns, 0.0)
        own = self.free_of(self.basis, whole)
        power, kept = np.sum(whole**2, axis=0), np.sum(own**2, axis=0)
        own = np.where(kept > _IMITATED * power, own, 0.0)
        share = float(np.sum(own**2) / max(float(power.sum()), 1e-300))
        if share == 0.0:
            return Signature(variant, own, 0.0, {**variant.shape, **(variant.effect.off or {})}, 0.0)
        mine = [parameters[s] for s in variant.amplitudes]
        scanned = any(s in variant.shape for s in variant.amplitudes)
        best = _at_scanned(variant, mine, own, self.r) if scanned else _bounded(mine, own, self.r)
        values = {p.symbol: a * p.domain.scale for p, a in zip(mine, best.amplitudes.tolist(), strict=True)}
        seen = int(np.sum(np.any(own != 0.0, axis=0)))
        return Signature(variant, own, best.gain, {**variant.shape, **values}, share, seen)


class Own(NamedTuple):
    """Of columns c, from some samples alone: r c, and |c|^2 of what no parameter can do, 0 where that is next to
    nothing; shape (k,) each."""

    way: np.ndarray
    power: np.ndarray

    @property
    def gain(self) -> np.ndarray:
        """By how much each column alone would lower chi2, its amplitude free, shape (k,)."""
        return np.divide(self.way**2, self.power, out=np.zeros(self.way.size), where=self.power > 0.0)


class Best(NamedTuple):
    """Amplitudes over their scales, shape (k,), and by how much they lower chi2."""

    amplitudes: np.ndarray
    gain: float


def _at_scanned(variant: Variant, mine: Sequence[Parameter], columns: np.ndarray, r: np.ndarray) -> Best:
    """Scanned amplitudes at their scanned values: a secant says what that value does, and nothing of a smaller one."""
    amplitudes = np.array([variant.shape[p.symbol] / p.domain.scale for p in mine])
    return Best(amplitudes, max(float(r @ r - np.sum((r + columns @ amplitudes) ** 2)), 0.0))


def _bounded(mine: Sequence[Parameter], columns: np.ndarray, r: np.ndarray) -> Best:
    """Amplitudes over their scales that lower |r + C a|^2 the most, none beyond its bound."""
    size = np.linalg.norm(columns, axis=0)
    own = size > 0.0  # an amplitude without a signature stays at its off value
    q, upper = np.linalg.qr(columns[:, own] / size[own])
    target = -(q.T @ r)
    solution = bounded(upper, target, lowest([p.domain for p in mine])[own])
    gain = float(target @ target - np.sum((upper @ solution - target) ** 2))
    amplitudes = np.zeros(own.size)
    amplitudes[own] = solution / size[own]
    return Best(amplitudes, max(gain, 0.0))


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives of the residual of the fitted samples in the free parameters of a model, some at a time: all of them
    together would be the largest array of a diagnosis, and their kernel the longest to compile.

    Args:
        problem, x, weighted: the model, at coordinates x, shape (P,).
        wanted: symbols of which the derivative is kept, once it was worked out, for whoever asks for it later.
        kept: those, in the value (SI), shape (n,) each.
    """

    problem: EstimationProblem
    x: np.ndarray
    weighted: WeightedData
    wanted: frozenset[str]
    kept: dict[str, np.ndarray]

    @classmethod
    def of(
        cls, problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, wanted: Iterable[str] = ()
    ) -> Tangents:
        """Those of a model, none worked out yet."""
        return cls(problem, x, weighted, frozenset(wanted), {})

    def together(self, symbols: tuple[str, ...]) -> dict[str, np.ndarray]:
        """By each of these free parameters, SI, shape (n,)."""
        found = dict(zip(symbols, slopes_of(self.problem, self.x, self.weighted, symbols), strict=True))
        self.kept.update({s: np.array(column) for s, column in found.items() if s in self.wanted})
        return found

    def along(self, symbol: str, scale: float) -> np.ndarray | None:
        """By a parameter over a scale, SI, shape (n,); None where it is not free."""
        if symbol not in self.problem.layout.free:
            return None
        return (self.kept[symbol] if symbol in self.kept else self.together((symbol,))[symbol]) * scale


def screen_of_the_rig(
    background: Background,
    tangents: Tangents,
    candidates: Sequence[Effect],
    kept: Callable[[Signature], Signature] = lambda whole: whole,
) -> list[Signature]:
    """The signature of every candidate that acts around the throttle.

    Their tangents are columns of the Jacobian of the lean model with all of them free, some at a time.

    Args:
        background: of the model and residual without them.
        tangents: of the model with all of them at work, at their off values.
        candidates: effects of the rig.
        kept: what is kept of each signature.
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


def slopes_of(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, symbols: tuple[str, ...]
) -> list[np.ndarray]:
    """Derivative of the fitted samples' residual in the value of each free parameter that is named, shape (n,) each."""
    layout, seen = problem.layout, np.asarray(weighted.slots.weight) > 0.0
    if available():
        full = layout.form.full(layout.padded(x), weighted.pick)
        columns = residual_kernels.linearised(layout.form, full, weighted, symbols)[1][seen]
        return [*columns.T]
    jacobian, slope = problem.linearise(x, weighted)[2][seen], layout.numbers(x)[1]
    return [jacobian[:, k] / slope[k] for k in map(layout.free.index, symbols)]


def some_at_once(every: Sequence[Variant], amplitudes: int) -> list[list[Variant]]:
    """Variants in order, so many amplitudes together, or a few more."""
    out: list[list[Variant]] = []
    count = amplitudes
    for variant in every:
        if count >= amplitudes:
            out, count = [*out, []], 0
        out[-1].append(variant)
        count += len(variant.amplitudes)
    return out


def ranked(signatures: Sequence[Signature]) -> tuple[Signature, ...]:
    """The best variant of each effect, the largest gain first."""
    best: dict[Effect, Signature] = {}
    for signature in signatures:
        effect = signature.variant.effect
        if effect not in best or signature.gain > best[effect].gain:
            best[effect] = signature
    return tuple(sorted(best.values(), key=lambda s: -s.gain))
