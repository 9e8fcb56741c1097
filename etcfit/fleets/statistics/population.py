"""What a design is and by how much its units differ, from every unit's own estimate: two-stage empirical Bayes.

    estimate_u ~ N(theta_u, information_u^-1),   theta_u ~ N(mu, Omega)

Units' own uncertainty is taken off the spread: a fleet whose units scatter no more than their stated errors has a
spread of nought, and is said to have. What no unit's data tell (a gear's two inertias, of which only a sum acts) is
not in the population but named in `uninformed`; the rest is estimated with nothing assumed of it.

A few odd units must not widen the spread. They are found by their distance from a first, robust look (medians symbol by
symbol, each unit's own variance taken off), left out, and the population is estimated again; then each is judged anew,
those inside and those outside, until the set stays as it is. Leaving out was chosen over t-weights: weights estimate
the scatter of a heavy-tailed fleet, which is biased low for the ordinary one and needs a guess of the tail, while an
odd unit of a line is a different thing, to be named and looked at. As only what is far beyond chance is left out
(`FleetSettings.odd_rate`), a healthy fleet keeps all its units and its estimate is the efficient one.

The distance of a unit, and how sure it is:

    d_u^2 = (x_u - mu)^T (F_u^-1 + Omega + C_u)^-1 (x_u - mu),   degrees of freedom: the rank of F_u

C_u is the covariance of the mean for a unit that took no part in it, else nothing. The spread is known from n units
only, so d^2 / k is compared with F(k, n) instead of chi2: exact for none, right to first order for few units. A unit
that is far in one symbol alone is better seen there, see `single_symbol_p`; p is twice the smaller of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import stats

from ..settings import DEFAULT, FleetSettings, PopulationSettings
from .likelihood import Spread, maximised, mean_intervals, spread_intervals, spread_view, weigh, weights
from .stack import NULL, Scaled, Stack, scaled

ROUNDS = 10  # times at most that units are left out or taken back, and the population is estimated again
LEAST_SHARE = 0.7  # of the units that stays in the population, whatever the others are like


@dataclass(frozen=True, eq=False)
class Population:
    """The design and its spread, SI."""

    symbols: tuple[str, ...]  # that the fleet's data determine, P of them
    mean: Float[np.ndarray, " P"]  # mu
    covariance: Float[np.ndarray, "P P"]  # Omega, zero for shared symbols
    mean_covariance: Float[np.ndarray, "P P"]  # of mu if Omega were known
    mean_stderr: Float[np.ndarray, " P"]  # by the scatter of the units; NaN where one unit alone determines the symbol
    degrees: Float[np.ndarray, " P"]  # of freedom of `mean_stderr`
    mean_interval: Float[np.ndarray, "P 2"]  # lower and upper bound; NaN where there is none
    sd_interval: Float[np.ndarray, "P 2"]  # of the standard deviation between units; NaN for shared symbols
    shared: Bool[np.ndarray, " P"]  # whether one value holds for all units
    informed: Int[np.ndarray, " P"]  # number of units whose own data alone determine it
    uninformed: tuple[str, ...]  # symbols that the fleet's data do not determine
    units: tuple[str, ...]  # that the population is estimated from
    left_out: tuple[str, ...]  # those too far from it

    @property
    def sd(self) -> Float[np.ndarray, " P"]:
        """Standard deviation between units, shape (P,); 0 for shared symbols and where units are not seen to differ."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "P P"]:
        """Between units; 0 beside a symbol without spread, 1 on the diagonal."""
        scale = np.where(self.sd > 0.0, self.sd, 1.0)
        out = self.covariance / scale[:, None] / scale[None, :]
        np.fill_diagonal(out, 1.0)
        return out


def population(stack: Stack, shared: Sequence[str] = (), settings: FleetSettings = DEFAULT) -> Population:
    """Estimate it, with one value for all units of the shared symbols.

    Raises:
        ValueError: fewer than two units, a shared symbol that no unit has, or nothing told at all.
    """
    if len(stack.units) < 2:
        raise ValueError(f"{len(stack.units)} unit: a population needs two or more.")
    if unknown := [s for s in shared if s not in stack.symbols]:
        raise ValueError(f"shared = {unknown}: no unit has it. They have: {', '.join(stack.symbols)}.")
    left = identifiable_symbols(stack, shared)
    if not left.symbols:
        raise ValueError("no symbol is told by the fleet's data: nothing to make a population of.")
    data, own = scaled(left), np.array([s not in shared for s in left.symbols])
    alone, spread, kept = _without_odd(data, own, settings)
    part, scale = data.only(kept), data.scale
    at = weigh(part, spread, 0.0)
    stderr, degrees, interval = mean_intervals(at, settings.population.level)
    bounds = np.full((len(scale), 2), np.nan)
    bounds[own] = spread_intervals(part, alone, settings.population)
    two = scale[:, None] * scale[None, :]
    return Population(
        symbols=left.symbols,
        mean=data.centre + scale * at.mean,
        covariance=two * spread.covariance,
        mean_covariance=two * at.mean_covariance,
        mean_stderr=scale * stderr,
        degrees=degrees,
        mean_interval=data.centre[:, None] + scale[:, None] * interval,
        sd_interval=scale[:, None] * bounds,
        shared=~own,
        informed=data.tells.sum(axis=0),
        uninformed=tuple(s for s in stack.symbols if s not in left.symbols),
        units=part.stack.units,
        left_out=tuple(unit for unit, inside in zip(stack.units, kept, strict=True) if not inside),
    )


def identifiable_symbols(stack: Stack, shared: Sequence[str]) -> Stack:
    """The stack of the symbols that all data together identify; the others are marginalised: no value is assumed.

    A symbol is identifiable if it is not in the null space of sum F, and, where it differs between units, if two units
    have data of it: one unit shows no spread.
    """
    total = stack.information.sum(axis=0)
    size = np.sqrt(np.where((d := np.diag(total)) > 0.0, d, 1.0))
    value, vector = np.linalg.eigh(total / size[:, None] / size[None, :])
    blind = np.sum(vector[:, value <= NULL * max(float(value[-1]), 1e-300)] ** 2, axis=1) > 1e-6
    having = np.sum(np.einsum("upp->up", stack.information) > 0.0, axis=0)
    good = [s for p, s in enumerate(stack.symbols) if not blind[p] and having[p] >= (1 if s in shared else 2)]
    return stack.marginal(good)


def _without_odd(data: Scaled, own: np.ndarray, settings: FleetSettings) -> tuple[Spread, Spread, np.ndarray]:
    """The spread among the ordinary units, as its standard deviations and as its correlations were estimated, and which
    units they are."""
    all_units = np.ones(len(data.x), dtype=bool)
    size = int(own.sum())
    robust = np.where(own, data.spread, 0.0)
    zero = np.zeros_like(robust)
    kept = _ordinary(distances(data, zero, np.diag(robust**2), np.diag(zero), all_units), settings.odd_rate)
    start = Spread(own, np.maximum(data.spread[own], 0.1), np.zeros(size * (size - 1) // 2))
    for _ in range(ROUNDS):
        part = data.only(kept)
        alone, spread = _estimated(part, start, settings.population)
        at = weigh(part, spread, 0.0)
        far = distances(data, at.mean, spread.covariance, at.mean_covariance, kept)
        again = _ordinary(far, settings.odd_rate)
        if np.array_equal(again, kept):
            break
        kept, start = again, spread.at(np.concatenate([np.maximum(spread.d, 0.1), spread.a]))
    return alone, spread, kept


def _ordinary(far: Distances, rate: float) -> np.ndarray:
    """Units that stay: none of those found odd, but never fewer than the share that must, and all of a few."""
    count = len(far.p)
    if count < FEWEST:
        return np.ones(count, dtype=bool)
    out = ~rejected(far.p, rate)
    least = int(np.ceil(LEAST_SHARE * count))
    if out.sum() < least:
        out = np.zeros(count, dtype=bool)
        out[np.argsort(-far.p, kind="stable")[:least]] = True
    return out


def _estimated(data: Scaled, start: Spread, settings: PopulationSettings) -> tuple[Spread, Spread]:
    """Standard deviations with next to no prior of the correlations, then the correlations with these held.

    Both at once would let the prior of the correlations, which draws them towards nought, draw on the standard
    deviations too: 20 units of 8 symbols came out with 9 % less spread than they were drawn with.
    """
    view = spread_view(data, start, settings)
    alone = maximised(view.data, view.start, view.held, view.prior)
    # insignificant standard deviations are set to zero
    value = weigh(view.data, alone, view.prior).value
    for j in np.argsort(alone.d):
        vector = alone.vector.copy()
        vector[j] = 0.0
        tried = alone.at(vector)
        if (there := weigh(view.data, tried, view.prior).value) > value + 1e-3:
            break
        alone, value = tried, there
    deviations = np.arange(len(start.vector)) < len(start.d)
    first = alone.at(np.concatenate([alone.d, start.a]))
    return alone, maximised(data, first, deviations, settings.uncorrelated * len(start.d))


@dataclass(frozen=True, eq=False)
class Shrunk:
    """N units, P symbols of the population, SI."""

    units: tuple[str, ...]  # their names
    symbols: tuple[str, ...]  # of the population
    estimate: Float[np.ndarray, "N P"]  # posterior means
    covariance: Float[np.ndarray, "N P P"]  # given the population
    stderr: Float[np.ndarray, "N P"]  # that of the population's mean included


def shrink(stack: Stack, of: Population) -> Shrunk:
    """Each unit's posterior, the population being its prior: what a unit with few traces is worth.

        mean_u = (F_u + Omega^-1)^-1 (F_u estimate_u + Omega^-1 mu) = mu + Omega W_u (estimate_u - mu)
        covariance_u = (F_u + Omega^-1)^-1 = Omega - Omega W_u Omega,   W_u = H_u^T (I + H_u Omega H_u^T)^-1 H_u

    The right-hand forms need no Omega^-1: a shared symbol, Omega = 0 there, takes the common value. That mu itself is
    estimated adds A C A^T with A = I - Omega W_u, C the covariance of mu: all the uncertainty that a shared symbol has.

    An odd unit is none of the population: its shrunk values are pulled to where it does not belong, and its own are
    those to use.

    Source: Efron and Morris 1973 (JASA 68), eq. 2.1; Lindley and Smith 1972 (JRSS B 34), eq. 12. Differs from source:
    no.

    The units may be others than those of the population, too.

    Raises:
        ValueError: the units lack a symbol of the population.
    """
    if missing := [s for s in of.symbols if s not in stack.symbols]:
        raise ValueError(f"the population has {', '.join(missing)}, which none of these units has.")
    data = scaled(stack.marginal(of.symbols))
    s = data.scale
    omega, c = of.covariance / np.outer(s, s), of.mean_covariance / np.outer(s, s)
    _, solved = weights(data, omega)
    gain = omega @ np.swapaxes(data.root, 1, 2) @ solved  # Omega W
    mean = (of.mean - data.centre) / s
    estimate = mean + np.einsum("upq,uq->up", gain, data.x - mean)
    covariance = omega - gain @ omega
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    left = np.eye(len(s)) - gain
    whole = np.einsum("upp->up", covariance) + np.einsum("upq,qr,upr->up", left, c, left)
    return Shrunk(stack.units, of.symbols, data.centre + s * estimate, covariance * np.outer(s, s),
                  s * np.sqrt(np.maximum(whole, 0.0)))  # fmt: skip


LEAST = 1e-300  # smaller p values count as this one
MANY = 100  # scores without which a quantile of the tail is noise
TAIL = 0.9  # quantile of the fleet's own scores that, beside the median, sets the scale of the null
FEWEST = 4  # units whose data determine a symbol; of fewer none can be called far


@dataclass(frozen=True, eq=False)
class Distances:
    """Of N units."""

    squared: Float[np.ndarray, " N"]  # d^2
    rank: Float[np.ndarray, " N"]  # directions the unit informs
    scale: float  # of the null, see `null_scale`
    # chance that an ordinary unit is as far, in all symbols or in any one, shape (N,); 1 where a unit informs nothing
    p: Float[np.ndarray, " N"]


def distances(
    data: Scaled, mean: np.ndarray, covariance: np.ndarray, of_mean: np.ndarray, inside: Bool[np.ndarray, " N"]
) -> Distances:
    """Every unit's, by mu, Omega and C, scaled; `inside`: whether a unit took part in these."""
    squared = np.zeros(len(data.x))
    for group, spread in ((inside, covariance), (~inside, covariance + of_mean)):
        if np.any(group):
            part = data.only(group)
            m, _ = weights(part, spread)
            error = np.einsum("ujk,uk->uj", part.root, part.x - mean)
            squared[group] = np.sum(error * np.linalg.solve(m, error[:, :, None])[:, :, 0], axis=1)
    k = np.maximum(data.rank, 1.0)
    p = np.where(data.rank > 0.0, stats.f.sf(squared / k, k, float(inside.sum())), 1.0)
    score = stats.norm.isf(0.5 * np.clip(p, LEAST, 1.0))
    told = data.rank > 0.0
    scale = null_scale(score[told]) if np.any(told) else 1.0
    together = np.where(told, 2.0 * stats.norm.sf(score / scale), 1.0)
    apart = single_symbol_p(data, mean, np.diag(covariance), inside)
    return Distances(squared, data.rank, scale, np.minimum(1.0, 2.0 * np.minimum(together, apart)))


def single_symbol_p(
    data: Scaled, mean: Float[np.ndarray, " P"], between: Float[np.ndarray, " P"], inside: Bool[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Probability that an ordinary unit is as far in any of its symbols, judged by a scatter it has no part in, (N,).

        z_us = (x_us - mu_s) / sqrt(1/F_us + Omega_ss),  r = z / (s_z sqrt(1 - 1/n)),  t = r sqrt((n - 2)/(n - 1 - r^2))

    t has n - 2 degrees of freedom. Among a dozen units one that is far off in one symbol widens the very spread that it
    is measured by: its z cannot exceed (n - 1) / sqrt(n), and its distance over all symbols is diluted by those in
    which it is like the others. t is what z would be had the unit been left out. A unit that took no part is compared
    with the n that did, t = z / (s_z sqrt(1 + 1/n)), n - 1 degrees of freedom. s_z, near 1, takes up what stated errors
    are wrong by.

    Source: Cook and Weisberg 1982, Residuals and Influence in Regression, section 2.2 (externally studentised
    residuals). Differs from source: units weigh as they are known, for which n is first order.
    """
    p = np.ones(data.x.shape)
    for s in range(data.x.shape[1]):
        told = data.tells[:, s]
        if (told & inside).sum() >= FEWEST:
            z = (data.x[told, s] - mean[s]) / np.sqrt(data.variance[told, s] + between[s])
            p[told, s] = _studentised(z, inside[told])
    return np.minimum(1.0, np.maximum(data.tells.sum(axis=1), 1) * p.min(axis=1))


def _studentised(z: np.ndarray, inside: np.ndarray) -> np.ndarray:
    n = int(inside.sum())
    scatter = np.sqrt(np.sum(z[inside] ** 2) / (n - 1)) or 1.0
    r2 = np.minimum((z / scatter) ** 2 / (1.0 - 1.0 / n), (n - 1) * (1.0 - 1e-12))
    within = np.sqrt(r2 * (n - 2) / (n - 1 - r2))
    p = np.where(
        inside, 2.0 * stats.t.sf(within, n - 2), 2.0 * stats.t.sf(np.abs(z) / scatter / np.sqrt(1.0 + 1.0 / n), n - 1)
    )
    score = stats.norm.isf(0.5 * np.clip(p, LEAST, 1.0))
    return 2.0 * stats.norm.sf(score / null_scale(score))


def null_scale(score: Float[np.ndarray, " N"], tail: float = TAIL) -> float:
    """How much wider than N(0, 1) the scores of the ordinary units are, at least 1.

        max(1, median |z| / 0.6745, quantile_tail |z| / the normal's)

    Covariances of fits are not exact and errors have tails. Most units are ordinary, so the fleet's own middle says how
    scores are distributed where nothing is odd: the median for the scale, a higher quantile for the tail. Never below
    1: where the stated covariances are too wide, nothing is made odd by that.

    Args:
        score: standard normal if all were as in the book, either sign; at least one.
        tail: quantile of |score|; used for 100 scores or more, as a few odd ones reach into that of a dozen.
    """
    size = np.abs(score)
    wide = float(np.median(size)) / stats.norm.ppf(0.75)
    if len(size) >= MANY:
        wide = max(wide, float(np.quantile(size, tail)) / stats.norm.ppf(0.5 + 0.5 * tail))
    return float(max(1.0, wide))


def rejected(p: Float[np.ndarray, " N"], rate: float) -> Bool[np.ndarray, " N"]:
    """Hypotheses rejected so that a share `rate` of them is false, as expected: Benjamini and Hochberg 1995."""
    return stats.false_discovery_control(p) <= rate


def holm(p: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """p values that hold for all N at once, under any dependence: Holm 1979."""
    order = np.argsort(p)
    out = np.empty(len(p))
    out[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return out
