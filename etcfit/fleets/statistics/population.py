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
(`OddSettings.rate`), a healthy fleet keeps all its units and its estimate is the efficient one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .distances import Distances, distances
from .likelihood import Weighed, maximised, weigh
from .mean_interval import mean_intervals
from .multiplicity import found
from .scaled import Scaled, scaled
from .settings import DEFAULT, FleetSettings, PopulationSettings
from .spread import Spread
from .spread_interval import spread_intervals
from .spread_view import spread_view
from .stack import Stack

FEW = 4  # units with fewer of which none can be called odd


@dataclass(frozen=True, eq=False)
class Population:
    """The design and its spread, SI.

    Args:
        symbols: told by the fleet's data, P of them.
        mean: mu, shape (P,).
        covariance: Omega, zero for shared symbols, shape (P, P).
        mean_covariance: of mu if Omega were known, shape (P, P).
        mean_stderr: of mu, from the scatter of the units, shape (P,); NaN where one unit alone tells it.
        degrees: of freedom of `mean_stderr`, shape (P,).
        mean_interval: lower and upper bound, shape (P, 2); NaN where there is none.
        sd_interval: of the standard deviation between units, shape (P, 2); NaN for shared symbols.
        shared: whether one value holds for all units, shape (P,).
        informed: number of units whose own data alone tell it, shape (P,).
        uninformed: symbols that the fleet's data do not tell.
        units: that the population is estimated from.
        left_out: those too far from it.
    """

    symbols: tuple[str, ...]
    mean: Float[np.ndarray, " P"]
    covariance: Float[np.ndarray, "P P"]
    mean_covariance: Float[np.ndarray, "P P"]
    mean_stderr: Float[np.ndarray, " P"]
    degrees: Float[np.ndarray, " P"]
    mean_interval: Float[np.ndarray, "P 2"]
    sd_interval: Float[np.ndarray, "P 2"]
    shared: Bool[np.ndarray, " P"]
    informed: Int[np.ndarray, " P"]
    uninformed: tuple[str, ...]
    units: tuple[str, ...]
    left_out: tuple[str, ...]

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
    """Estimate it.

    Args:
        stack: units, see `stacked`.
        shared: symbols with one value for all units.
        settings: levels, prior of the correlations, when a unit is left out.
    Raises:
        ValueError: fewer than two units, a shared symbol that no unit has, or nothing told at all.
    """
    if len(stack.units) < 2:
        raise ValueError(f"{len(stack.units)} unit: a population needs two or more.")
    if unknown := [s for s in shared if s not in stack.symbols]:
        raise ValueError(f"shared = {unknown}: no unit has it. They have: {', '.join(stack.symbols)}.")
    left = identifiable_symbols(stack, shared, settings.population.null)
    if not left.symbols:
        raise ValueError("no symbol is told by the fleet's data: nothing to make a population of.")
    own = np.array([s not in shared for s in left.symbols])
    data = scaled(left, settings.population.null)
    estimated, kept = _without_odd(data, own, settings)
    uninformed = tuple(s for s in stack.symbols if s not in left.symbols)
    return _in_si(data, estimated, kept, uninformed, settings.population)


class Estimated(NamedTuple):
    """A spread.

    Args:
        own: as its standard deviations were estimated, with next to no prior of the correlations.
        whole: the same standard deviations, and correlations with their prior.
    """

    own: Spread
    whole: Spread


def identifiable_symbols(stack: Stack, shared: Sequence[str], null: float) -> Stack:
    """The stack of the symbols that all data together identify; the others are marginalised: no value is assumed.

    A symbol is identifiable if it is not in the null space of sum F, and, where it differs between units, if two units
    have data of it: one unit shows no spread.
    """
    total = stack.information.sum(axis=0)
    size = np.sqrt(np.where((d := np.diag(total)) > 0.0, d, 1.0))
    value, vector = np.linalg.eigh(total / size[:, None] / size[None, :])
    blind = np.sum(vector[:, value <= null * max(float(value[-1]), 1e-300)] ** 2, axis=1) > 1e-6
    having = np.sum(np.einsum("upp->up", stack.information) > 0.0, axis=0)
    good = [s for p, s in enumerate(stack.symbols) if not blind[p] and having[p] >= (1 if s in shared else 2)]
    return stack.marginal(good)


def _without_odd(data: Scaled, own: np.ndarray, settings: FleetSettings) -> tuple[Estimated, np.ndarray]:
    """The spread among the ordinary units, and which they are."""
    all_units = np.ones(len(data.x), dtype=bool)
    size = int(own.sum())
    robust = np.where(own, data.spread, 0.0)
    zero = np.zeros_like(robust)
    far = distances(data, zero, np.diag(robust**2), np.diag(zero), all_units, settings.odd)
    kept = _ordinary(far, settings) if len(data.x) >= FEW else all_units
    start = Spread(own, np.maximum(data.spread[own], 0.1), np.zeros(size * (size - 1) // 2))
    for _ in range(settings.population.rounds):
        part = data.only(kept)
        estimated = _estimated(part, start, settings.population)
        spread = estimated.whole
        at = weigh(part, spread, 0.0)
        far = distances(data, at.mean, spread.covariance, at.mean_covariance, kept, settings.odd)
        again = _ordinary(far, settings) if len(data.x) >= FEW else all_units
        if np.array_equal(again, kept):
            break
        kept, start = again, spread.at(np.concatenate([np.maximum(spread.d, 0.1), spread.a]))
    return estimated, kept


def _estimated(data: Scaled, start: Spread, settings: PopulationSettings) -> Estimated:
    """Standard deviations with next to no prior of the correlations, then the correlations with these held.

    Both at once would let the prior of the correlations, which draws them towards nought, draw on the standard
    deviations too: 20 units of 8 symbols came out with 9 % less spread than they were drawn with.
    """
    view = spread_view(data, start, settings)
    own = _zeroed(view.data, maximised(view.data, view.start, settings, view.held, view.prior), view.prior)
    correlations = np.arange(len(start.vector)) < len(start.d)
    first = own.at(np.concatenate([own.d, start.a]))
    prior = settings.uncorrelated * len(start.d)
    return Estimated(own, maximised(data, first, settings, correlations, prior))


def _ordinary(far: Distances, settings: FleetSettings) -> np.ndarray:
    """Units that stay: none of those found, but never fewer than the share that must."""
    out = ~found(far.p, settings.odd.rate)
    least = int(np.ceil(settings.population.fewest * len(out)))
    if out.sum() < least:
        out = np.zeros(len(out), dtype=bool)
        out[np.argsort(-far.p, kind="stable")[:least]] = True
    return out


def _zeroed(data: Scaled, spread: Spread, prior: float) -> Spread:
    """Insignificant standard deviations are set to zero."""
    value = weigh(data, spread, prior).value
    for j in np.argsort(spread.d):
        vector = spread.vector.copy()
        vector[j] = 0.0
        tried = spread.at(vector)
        if (there := weigh(data, tried, prior).value) > value + 1e-3:
            break
        spread, value = tried, there
    return spread


def _in_si(
    data: Scaled, estimated: Estimated, kept: np.ndarray, uninformed: tuple[str, ...], settings: PopulationSettings
) -> Population:
    spread = estimated.whole
    part, scale, symbols = data.only(kept), data.scale, data.stack.symbols
    at: Weighed = weigh(part, spread, 0.0)
    stderr, degrees, interval = mean_intervals(at, settings.level)
    bounds = np.full((len(symbols), 2), np.nan)
    bounds[spread.own] = spread_intervals(part, estimated.own, settings)
    two = scale[:, None] * scale[None, :]
    return Population(
        symbols,
        data.centre + scale * at.mean,
        two * spread.covariance,
        two * at.mean_covariance,
        scale * stderr,
        degrees,
        data.centre[:, None] + scale[:, None] * interval,
        scale[:, None] * bounds,
        ~spread.own,
        data.tells.sum(axis=0),
        uninformed,
        part.stack.units,
        tuple(unit for unit, inside in zip(data.stack.units, kept, strict=True) if not inside),
    )
