"""The units of a fleet as arrays with an axis of units and one of symbols: in SI, with robust errors, and scaled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ..unit import UnitEstimate, UnitResult

MEDIAN_CHI2 = 0.4549364231195724  # median of chi2 with one degree of freedom
NULL = 1e-11  # share of a unit's largest eigenvalue of information (scaled) below which a direction counts as unknown
# Largest widening of a unit's standard errors by its own traces, over that of the median unit: 3 for the estimate of
# the population, which a unit with too small errors distorts; 2 for the estimate of the unit, which is pulled to the
# mean when its errors are too large
MOST_WIDENED, MOST_WIDENED_TO_SHRINK = 3.0, 2.0


@dataclass(frozen=True, eq=False)
class Stack:
    """Estimates of N units in the union of their symbols; a symbol that a unit does not have has no information."""

    units: tuple[str, ...]  # their names
    symbols: tuple[str, ...]  # in the order of their first appearance
    estimate: Float[np.ndarray, "N P"]  # SI
    information: Float[np.ndarray, "N P P"]  # 1/SI^2

    def only(self, kept: Bool[np.ndarray, " N"]) -> Stack:
        """The stack of these units alone."""
        names = tuple(unit for unit, keep in zip(self.units, kept, strict=True) if keep)
        return Stack(names, self.symbols, self.estimate[kept], self.information[kept])

    def marginal(self, symbols: Sequence[str]) -> Stack:
        """F_kk - F_kd F_dd^+ F_dk: the information on some symbols, marginalised over the others."""
        keep = [self.symbols.index(s) for s in symbols]
        drop = [p for p in range(len(self.symbols)) if p not in keep]
        kk, estimate = self.information[:, keep][:, :, keep], self.estimate[:, keep]
        if not drop:
            return Stack(self.units, tuple(symbols), estimate, kk)
        kd, dd = self.information[:, keep][:, :, drop], self.information[:, drop][:, :, drop]
        s = 1.0 / np.sqrt(np.where((d := np.einsum("upp->up", dd)) > 0.0, d, 1.0))
        inverse = np.linalg.pinv(dd * s[:, :, None] * s[:, None, :], rcond=1e-12, hermitian=True)
        inverse = inverse * s[:, :, None] * s[:, None, :]
        left = kk - kd @ inverse @ np.swapaxes(kd, 1, 2)
        return Stack(self.units, tuple(symbols), estimate, 0.5 * (left + np.swapaxes(left, 1, 2)))


def stacked(estimates: Sequence[UnitEstimate]) -> Stack:
    """The stack of all units.

    Raises:
        ValueError: no unit, a name twice, or an entry that is not finite.
    """
    if not estimates:
        raise ValueError("the fleet has no unit with a result: at least one is required.")
    names = tuple(each.unit for each in estimates)
    if len(set(names)) < len(names):
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)}: two units of the fleet have this name.")
    symbols = tuple(dict.fromkeys(s for each in estimates for s in each.symbols))
    place = {s: p for p, s in enumerate(symbols)}
    x, f = np.zeros((len(names), len(symbols))), np.zeros((len(names), len(symbols), len(symbols)))
    for u, each in enumerate(estimates):
        if not (np.all(np.isfinite(each.estimate)) and np.all(np.isfinite(each.information))):
            raise ValueError(f"{each.unit}: estimate and information must be finite; an unknown direction has zero.")
        at = np.array([place[s] for s in each.symbols], dtype=int)
        x[u, at] = each.estimate
        f[u, at[:, None], at[None, :]] = 0.5 * (each.information + each.information.T)
    return Stack(names, symbols, x, f)


def robust(units: Sequence[UnitResult], most: float) -> list[UnitEstimate]:
    """Each unit's own estimate, with an information that is valid although the model is not exact.

        information_u = S_u^-1 F_u S_u^-1,   S_u = diag(min(max(w_us, m_s), most m_s)),   m_s = median over u of w_us

    w_us is the factor by which the unit's own fit widens the standard error of symbol s, where residuals are correlated
    or traces disagree by more than their noise. The error of the model is the same in every unit of a design, and m_s
    measures it; no unit is more certain than that. But the disagreement of a handful of traces is hard to estimate:
    sound units are widened up to a hundred times and would have almost no weight. So no unit is widened by more than
    `most` times the widening of the others. A unit that is worse than that is not uncertain but odd.
    """
    symbols = {symbol for unit in units for symbol in unit.own.symbols}
    middle = {s: float(np.median([u.widening.get(s, 1.0) for u in units if s in u.own.symbols])) for s in symbols}
    out = []
    for unit in units:
        by = np.array([np.clip(unit.widening.get(s, 1.0), middle[s], most * middle[s]) for s in unit.own.symbols])
        out.append(replace(unit.own, information=unit.own.information / np.outer(by, by)))
    return out


@dataclass(frozen=True, eq=False)
class Scaled:
    """N units and P symbols, dimensionless: each symbol less its centre, over its scale.

        F_u = S^-1 H_u^T H_u S^-1,   x_u = S^-1 (estimate_u - centre)

    H_u has a zero row for every direction that the unit does not inform. All statistics use H and x, so that a
    direction without information has weight 0, and one with much information loses no digits.
    """

    stack: Stack  # the units in SI
    centre: Float[np.ndarray, " P"]  # robust, SI
    scale: Float[np.ndarray, " P"]  # SI
    root: Float[np.ndarray, "N P P"]  # H
    x: Float[np.ndarray, "N P"]
    rank: Float[np.ndarray, " N"]  # directions that each unit informs
    tells: Bool[np.ndarray, "N P"]  # whether a unit's data alone determine a symbol
    variance: Float[
        np.ndarray, "N P"
    ]  # of the unit's own estimate, marginal; infinite where its data determine nothing
    spread: Float[np.ndarray, " P"]  # robust standard deviation between units, symbol by symbol

    def only(self, kept: Bool[np.ndarray, " N"]) -> Scaled:
        """These units alone, with the same centre and scale."""
        arrays = (self.root[kept], self.x[kept], self.rank[kept], self.tells[kept], self.variance[kept])
        return Scaled(self.stack.only(kept), self.centre, self.scale, *arrays, self.spread)

    @property
    def marginal(self) -> Scaled:
        """Each symbol of each unit alone, with its marginal variance."""
        return replace(self, root=np.eye(self.x.shape[1]) / np.sqrt(self.variance)[:, None, :])


def scaled(stack: Stack) -> Scaled:
    """Scale a stack. Centre and scale are medians over the units whose data determine a symbol: odd units do not move
    them."""
    diagonal = np.einsum("upp->up", stack.information)
    own = np.array([1.0 / np.sqrt(np.median(d[d > 0.0])) if np.any(d > 0.0) else 1.0 for d in diagonal.T])
    root, rank, tells, variance = _roots(stack.information * own[:, None] * own[None, :])
    size = len(stack.symbols)
    centre, spread, wide = np.zeros(size), np.zeros(size), np.ones(size)
    for p in range(size):
        seen = tells[:, p] if np.any(tells[:, p]) else diagonal[:, p] > 0.0
        if not np.any(seen):
            continue
        value = stack.estimate[seen, p]
        noise = own[p] ** 2 * np.where(tells[seen, p], variance[seen, p], 1.0)
        # the centre is that of the half with the most precise estimates
        centre[p] = np.median(value[noise <= np.median(noise)])
        spread[p] = sd_between((value - np.median(value)) ** 2, noise)
        wide[p] = np.hypot(spread[p], np.sqrt(np.median(noise)))
    ratio = wide / own
    return Scaled(stack, centre, wide, root * ratio, (stack.estimate - centre) / wide, rank, tells,
                  variance / ratio**2, spread / wide)  # fmt: skip


def _roots(f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """H, rank, determined symbols and marginal variance, of information (N, P, P) with diagonals near one."""
    d = np.einsum("upp->up", f)
    s = np.sqrt(np.where(d > 0.0, d, 1.0))  # each unit by its own diagonal, so that a precise symbol hides no other one
    value, vector = np.linalg.eigh(f / (s[:, :, None] * s[:, None, :]))
    good = value > NULL * np.maximum(value[:, -1:], 1e-300)
    root = np.sqrt(np.where(good, value, 0.0))[:, :, None] * np.swapaxes(vector, 1, 2) * s[:, None, :]
    inside = np.sum(np.where(good[:, None, :], vector**2, 0.0), axis=2)
    tells = inside > 1.0 - 1e-6
    inverse = np.where(good, 1.0 / np.where(good, value, 1.0), 0.0)
    variance = np.where(tells, np.sum(vector**2 * inverse[:, None, :], axis=2) / s**2, np.inf)
    return root, good.sum(axis=1).astype(float), tells, variance


def sd_between(square: Float[np.ndarray, " n"], noise: Float[np.ndarray, " n"]) -> float:
    """The sd at which median(square / (sd^2 + noise)) is that of chi2 with one degree of freedom; 0 where it is below
    that at sd = 0."""
    low, high = 0.0, 10.0 * float(np.sqrt(np.max(square))) + 1e-300
    with np.errstate(divide="ignore", invalid="ignore"):
        if not np.median(np.where(square > 0.0, square / noise, 0.0)) > MEDIAN_CHI2:
            return 0.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.median(square / (middle**2 + noise)) > MEDIAN_CHI2 else (low, middle)
    return 0.5 * (low + high)
