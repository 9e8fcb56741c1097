"""Finds odd units, their causes and their p values, and the units that have an effect of the common model.

There are two criteria: the unit's parameters are far from the population (`distances`), or its model explains its
traces worse than those of the other units do (`misfits`). A unit's p is twice the smaller of the two (Bonferroni: they
may depend on each other); over all units Benjamini and Hochberg.

Two numbers for each symbol explain a large distance. `scores` are marginal: the symbol's own distance, own uncertainty
included. `drives` divide d^2 among the symbols, without correlations, so that their squares add up to it:

    z_j = x_j / sqrt(V_jj),   drives = (D V D)^-1/2 D x,   D = diag(V)^-1/2,   V = F^-1 + Omega

Source: Garthwaite and Koch 2016 (Psychometrika 81), the corr-max transformation. Differs from source: only symbols that
the unit's own data determine.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from ...errors import first_names
from ...model.effects import EFFECT_BY_NAME
from ..settings import DEFAULT
from ..unit import UnitResult
from .population import LEAST, MANY, TAIL, Population, distances, rejected
from .stack import Scaled, Stack, scaled

NAMED = 3.0  # score of a symbol or trace, standard deviations, from which on it is named
SHOWN = 3  # most symbols, and most traces, that the line `why` names
LEAST_SCATTER = 0.03  # least scale of the logarithm of misfits: smaller differences are ignored
COMMON = 0.5  # share of the units that must have a file of one name for these files to be compared


@dataclass(frozen=True)
class TraceScore:
    """The misfit of a trace compared with the same trace of the other units."""

    file: str  # below the unit's folder
    misfit: float  # root mean square of its whitened residual
    z: float  # of log misfit, robust standard deviations above the median


@dataclass(frozen=True)
class OddUnit:
    """One odd unit."""

    unit: str  # its name
    distance: float  # Mahalanobis distance from the population, d, in the null's standard deviations
    rank: int  # number of directions of that distance: an ordinary unit has d near sqrt(rank)
    p: float  # probability that an ordinary unit is as odd, by either criterion
    rate: float  # least rate of false ones at which it is still called odd
    symbols: tuple[str, ...]  # symbols that make it odd, worst first; empty where only its traces do
    scores: Mapping[str, float]  # z of every symbol that its data determine
    drives: Mapping[str, float]  # share of each in the distance, signed
    misfit: float  # z of its chi2 per degree of freedom among the fleet's; 0 where it is unknown
    traces: tuple[TraceScore, ...]  # traces that make it odd, worst first
    why: str  # one line


def odd_units(
    stack: Stack, of: Population, results: Sequence[UnitResult] = (), rate: float = DEFAULT.odd_rate
) -> tuple[OddUnit, ...]:
    """The odd units, the most odd first.

    Args:
        stack, of: units, and their population.
        results: results in the order of the stack, for misfits; where empty, only parameters are compared.
        rate: rate of false ones among those found.
    Raises:
        ValueError: the results are not of the units of the stack.
    """
    if results and tuple(each.unit for each in results) != stack.units:
        raise ValueError("results: the same units in the same order as in the stack are needed.")
    data = scaled(stack.marginal(of.symbols))
    s, inside = data.scale, np.isin(stack.units, of.units)
    mean = (of.mean - data.centre) / s
    omega, c = of.covariance / np.outer(s, s), of.mean_covariance / np.outer(s, s)
    far = distances(data, mean, omega, c, inside)
    left = misfits(results) if results else None
    p = np.minimum(1.0, 2.0 * np.minimum(far.p, left.p)) if left else far.p
    rates = stats.false_discovery_control(p)
    odd = rates <= rate
    level = float(np.max(p[odd])) if np.any(odd) else 0.0
    out = []
    for u in sorted(np.flatnonzero(odd), key=lambda u: (p[u], -far.squared[u])):
        z, drives = _scores(data, mean, omega + c * (not inside[u]), int(u), far.scale)
        names = [name for name, tells in zip(data.stack.symbols, data.tells[u], strict=True) if tells]
        order = np.argsort(-np.abs(drives), kind="stable")
        strong = [k for k in order if abs(drives[k]) >= NAMED] or list(order[:1])
        symbols = tuple(names[k] for k in strong) if far.p[u] <= max(level, LEAST) else ()
        traces = tuple(t for t in left.traces[u] if t.z >= NAMED) if left else ()
        misfit = float(left.whole[u]) if left else 0.0
        scores, driving = (dict(zip(names, map(float, each), strict=True)) for each in (z, drives))
        distance = float(np.sqrt(far.squared[u])) / far.scale
        why = _why(symbols, scores, driving, misfit, traces)
        out.append(OddUnit(stack.units[u], distance, int(far.rank[u]), float(p[u]), float(rates[u]), symbols, scores,
                           driving, misfit, traces, why))  # fmt: skip
    return tuple(out)


def _scores(data: Scaled, mean: np.ndarray, between: np.ndarray, u: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """z and drives of the symbols that unit u's data determine."""
    determined = np.flatnonzero(data.tells[u])
    root = data.root[u]
    own = np.linalg.pinv(root.T @ root, rcond=1e-13, hermitian=True)
    v = (own + between)[np.ix_(determined, determined)]
    x = (data.x[u] - mean)[determined]
    z = x / np.sqrt(np.diag(v))
    value, vector = np.linalg.eigh(v / np.sqrt(np.outer(np.diag(v), np.diag(v))))
    drives = vector @ ((vector.T @ z) / np.sqrt(np.maximum(value, 1e-12)))
    return z / scale, drives / scale


def _why(
    symbols: tuple[str, ...], scores: Mapping[str, float], drives: Mapping[str, float], misfit: float,
    traces: tuple[TraceScore, ...],
) -> str:  # fmt: skip
    parts = []
    if symbols:  # the marginal score where it is large, otherwise the score given the other parameters
        said = [f"{s} {scores[s]:+.1f} sd" if abs(scores[s]) >= NAMED
                else f"{s} {drives[s]:+.1f} sd for its other parameters" for s in symbols]  # fmt: skip
        parts.append(f"{first_names(said, SHOWN)} from the fleet")
    if traces:
        said = [f"{t.file} (misfit {t.misfit:.3g}, {t.z:+.0f} sd)" for t in traces]
        parts.append(f"its model explains {first_names(said, SHOWN)} worse than other units'")
    elif misfit >= NAMED:
        parts.append(f"its model explains its traces worse than other units' ({misfit:+.1f} sd)")
    return "; ".join(parts) or "no single symbol or trace, but all together"


@dataclass(frozen=True, eq=False)
class Misfits:
    """N units."""

    whole: Float[np.ndarray, " N"]  # z of chi2 per degree of freedom
    traces: tuple[tuple[TraceScore, ...], ...]  # of each unit, worst first
    p: Float[np.ndarray, " N"]  # probability that an ordinary unit has as large a misfit


def misfits(results: Sequence[UnitResult]) -> Misfits:
    """The misfit of each unit's own model compared with those of the other units' models.

        z = (log m_u - median log m) / (1.4826 MAD),   m: chi2 per degree of freedom, or the misfit of one trace

    This criterion needs no covariance: a defect that no parameter can imitate increases the misfit without moving an
    estimate. Traces are compared with those of the same file name, or of the same rig test where units have different
    names. Only a large misfit counts. The two p values of a unit (all traces, the worst trace) are combined by
    Bonferroni.
    """
    whole = _robust_scores(np.array([each.chi2_per_dof for each in results]))
    traces = _trace_scores(results)
    worst = np.array([t[0].z if t else 0.0 for t in traces])
    many = np.array([max(len(t), 1) for t in traces])
    of_worst = -np.expm1(many * np.log1p(-np.minimum(stats.norm.sf(worst), 1.0 - 1e-16)))
    return Misfits(whole, traces, np.minimum(1.0, 2.0 * np.minimum(stats.norm.sf(whole), of_worst)))


def _robust_scores(value: np.ndarray) -> np.ndarray:
    """(log value - median) / scale; the scale is the largest of MAD, upper tail and `LEAST_SCATTER`."""
    log = np.log(np.maximum(value, 1e-300))
    middle = float(np.median(log))
    scale = max(1.4826 * float(np.median(np.abs(log - middle))), LEAST_SCATTER)
    if len(log) >= MANY:
        reach = float(np.quantile(log, 0.5 + 0.5 * TAIL)) - middle
        scale = max(scale, reach / float(stats.norm.ppf(0.5 + 0.5 * TAIL)))
    return (log - middle) / scale


def _trace_scores(results: Sequence[UnitResult]) -> tuple[tuple[TraceScore, ...], ...]:
    having: dict[str, int] = defaultdict(int)
    for each in results:
        for trace in each.traces:
            having[trace.file] += 1
    groups: dict[str, list[tuple[int, str, float]]] = defaultdict(list)
    for u, each in enumerate(results):
        for trace in each.traces:
            alike = trace.file if having[trace.file] >= COMMON * len(results) else f"any {trace.test}"
            groups[alike].append((u, trace.file, trace.misfit))
    out: list[list[TraceScore]] = [[] for _ in results]
    for group in groups.values():
        for (u, file, misfit), z in zip(group, _robust_scores(np.array([m for *_, m in group])), strict=True):
            out[u].append(TraceScore(file, misfit, float(z)))
    return tuple(tuple(sorted(t, key=lambda s: -s.z)) for t in out)


@dataclass(frozen=True)
class EffectInFleet:
    """One effect."""

    effect: str  # its name
    symbol: str  # the amplitude that measures its strength
    units: tuple[str, ...]  # units that have it
    of: int  # number of units whose data determine it
    median: float  # median of the strength over these, SI
    strength: Mapping[str, float]  # by unit, SI: as estimated, also below 0
    p: Mapping[str, float]  # by unit, p value of its absence


def effects_in(stack: Stack, names: Sequence[str], rate: float = DEFAULT.effect_rate) -> tuple[EffectInFleet, ...]:
    """The units that have an effect of the common model, and its strength in each.

        w_u = (s_u - off)^T V_u^-1 (s_u - off) ~ chi2 with as many degrees of freedom as amplitudes, if it is absent

    V_u is the block of the unit's own covariance, so the result does not depend on other units. Over the units
    Benjamini and Hochberg. A unit whose data do not determine the amplitudes is not counted.

    Args:
        names: of effects, as in rig.toml; an effect without an off value, or whose amplitude no unit's data determine,
            is left out.
        rate: rate of units that falsely have it, among those reported.
    Raises:
        ValueError: no effect has such a name.
    """
    if unknown := [name for name in names if name not in EFFECT_BY_NAME]:
        raise ValueError(f"no effect is called {', '.join(unknown)}. There are: {', '.join(EFFECT_BY_NAME)}.")
    out = []
    for name in names:
        off = {s: v for s, v in (EFFECT_BY_NAME[name].off or {}).items() if s in stack.symbols}
        if not off:
            continue
        data = scaled(stack.marginal(tuple(off)))
        tells = np.all(data.tells, axis=1)
        if not np.any(tells):
            continue
        error = data.x[tells] - (np.array(list(off.values())) - data.centre) / data.scale
        wald = np.sum(np.einsum("ujk,uk->uj", data.root[tells], error) ** 2, axis=1)
        p = stats.chi2.sf(wald, len(off))
        units = [unit for unit, each in zip(stack.units, tells, strict=True) if each]
        having = tuple(unit for unit, has in zip(units, rejected(p, rate), strict=True) if has)
        strength = data.stack.estimate[tells, 0]
        by_unit = (dict(zip(units, map(float, each), strict=True)) for each in (strength, p))
        out.append(EffectInFleet(name, next(iter(off)), having, len(units), float(np.median(strength)), *by_unit))
    return tuple(out)
