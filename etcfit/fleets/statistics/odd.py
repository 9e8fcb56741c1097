"""Which units are unlike the others, by what, and how sure that is.

Two grounds that know nothing of each other: the unit's parameters are far from the population (`distances`), or its
model leaves more of its traces unexplained than the others' do (`misfits`). A unit's p is twice the smaller of the two
(Bonferroni: they may depend on each other); over all units Benjamini and Hochberg.

What makes a unit far is told in two ways. `scores` are marginal: the symbol's own distance, own uncertainty included.
`drives` share d^2 out among the symbols so that the squares add up to it, correlations taken off:

    z_j = x_j / sqrt(V_jj),   drives = (D V D)^-1/2 D x,   D = diag(V)^-1/2,   V = F^-1 + Omega

Source: Garthwaite and Koch 2016 (Psychometrika 81), the corr-max transformation. Differs from source: only symbols that
the unit's own data tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..unit import UnitResult
from .distances import Distances, distances
from .misfits import Misfits, TraceScore, misfits
from .multiplicity import LEAST, adjusted, found
from .population import Population
from .scaled import Scaled, scaled
from .settings import DEFAULT, FleetSettings, OddSettings
from .stack import Stack


@dataclass(frozen=True)
class OddUnit:
    """One of them.

    Args:
        unit: its name.
        distance: Mahalanobis distance from the population, d, in the null's standard deviations.
        rank: directions in which that is measured: an ordinary unit has d near sqrt(rank).
        p: that an ordinary unit is as odd, on either ground.
        rate: the least rate of false ones at which it would still be called odd.
        symbols: that make it odd, worst first; none where only its traces do.
        scores: z of every symbol that its data tell.
        drives: share of each in the distance, signed.
        misfit: z of its chi2 per degree of freedom among the fleet's; 0 where none is known.
        traces: that make it odd, worst first.
        why: one line.
    """

    unit: str
    distance: float
    rank: int
    p: float
    rate: float
    symbols: tuple[str, ...]
    scores: Mapping[str, float]
    drives: Mapping[str, float]
    misfit: float
    traces: tuple[TraceScore, ...]
    why: str


def odd_units(
    stack: Stack, of: Population, results: Sequence[UnitResult] = (), settings: FleetSettings = DEFAULT
) -> tuple[OddUnit, ...]:
    """The odd units, most odd first.

    Args:
        stack: units.
        of: the population of these units.
        results: in the order of the stack, for misfits; none, and only parameters are judged.
    Raises:
        ValueError: results of other units than the stack's.
    """
    if results and tuple(each.unit for each in results) != stack.units:
        raise ValueError("results: the same units in the same order as in the stack are needed.")
    data = scaled(stack.marginal(of.symbols), settings.population.null)
    s, inside = data.scale, np.isin(stack.units, of.units)
    mean = (of.mean - data.centre) / s
    omega, c = of.covariance / np.outer(s, s), of.mean_covariance / np.outer(s, s)
    far = distances(data, mean, omega, c, inside, settings.odd)
    left = misfits(results, settings.odd) if results else None
    p = np.minimum(1.0, 2.0 * np.minimum(far.p, left.p)) if left else far.p
    rate, odd = adjusted(p), found(p, settings.odd.rate)
    level = float(np.max(p[odd])) if np.any(odd) else 0.0
    order = sorted(np.flatnonzero(odd), key=lambda u: (p[u], -far.squared[u]))
    return tuple(_odd(data, mean, omega + c * (not inside[u]), far, left, int(u), p[u], rate[u], level, settings.odd)
                 for u in order)  # fmt: skip


def _odd(
    data: Scaled, mean: np.ndarray, between: np.ndarray, far: Distances, left: Misfits | None, u: int, p: float,
    rate: float, level: float, settings: OddSettings,
) -> OddUnit:  # fmt: skip
    z, drives = _scores(data, mean, between, u, far.scale)
    names = [name for name, tells in zip(data.stack.symbols, data.tells[u], strict=True) if tells]
    by_distance = far.p[u] <= max(level, LEAST)
    order = np.argsort(-np.abs(drives), kind="stable")
    strong = [k for k in order if abs(drives[k]) >= settings.named] or list(order[:1])
    symbols = tuple(names[k] for k in strong) if by_distance else ()
    traces = tuple(t for t in left.traces[u] if t.z >= settings.named) if left else ()
    misfit = float(left.whole[u]) if left else 0.0
    scores, driving = dict(zip(names, map(float, z), strict=True)), dict(zip(names, map(float, drives), strict=True))
    distance = float(np.sqrt(far.squared[u])) / far.scale
    why = _why(symbols, scores, driving, misfit, traces, settings)
    return OddUnit(data.stack.units[u], distance, int(far.rank[u]), float(p), float(rate), symbols, scores, driving,
                   misfit, traces, why)  # fmt: skip


def _scores(data: Scaled, mean: np.ndarray, between: np.ndarray, u: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """z and drives of the symbols that unit u tells."""
    told = np.flatnonzero(data.tells[u])
    root = data.root[u]
    own = np.linalg.pinv(root.T @ root, rcond=1e-13, hermitian=True)
    v = (own + between)[np.ix_(told, told)]
    x = (data.x[u] - mean)[told]
    z = x / np.sqrt(np.diag(v))
    value, vector = np.linalg.eigh(v / np.sqrt(np.outer(np.diag(v), np.diag(v))))
    drives = vector @ ((vector.T @ z) / np.sqrt(np.maximum(value, 1e-12)))
    return z / scale, drives / scale


def _why(
    symbols: tuple[str, ...], scores: Mapping[str, float], drives: Mapping[str, float], misfit: float,
    traces: tuple[TraceScore, ...], settings: OddSettings,
) -> str:  # fmt: skip
    parts = []
    if symbols:
        said = [_deviation(s, scores[s], drives[s], settings.named) for s in symbols[: settings.shown]]
        more = f" and {len(symbols) - settings.shown} more" if len(symbols) > settings.shown else ""
        parts.append(f"{', '.join(said)}{more} from the fleet")
    if traces:
        said = [f"{t.file} (misfit {t.misfit:.3g}, {t.z:+.0f} sd)" for t in traces[: settings.shown]]
        more = f" and {len(traces) - settings.shown} more" if len(traces) > settings.shown else ""
        parts.append(f"its model explains {', '.join(said)}{more} worse than other units'")
    elif misfit >= settings.named:
        parts.append(f"its model explains its traces worse than other units' ({misfit:+.1f} sd)")
    return "; ".join(parts) or "no single symbol or trace, but all together"


def _deviation(symbol: str, score: float, drive: float, named: float) -> str:
    """By itself, or, where that is no more than usual, given what its other parameters are."""
    return f"{symbol} {score:+.1f} sd" if abs(score) >= named else f"{symbol} {drive:+.1f} sd for its other parameters"
