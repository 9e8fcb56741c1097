"""A fitted model without its data: of one unit with the state of its fit, and of many units of one design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..backend import compiled_quickly
from ..errors import UsageError
from ..model.effects import AbstractEffect
from ..model.parameters import NonNegative, Parameter, Positive, Real
from ..model.rig_effects import AbstractRigEffect
from ..model.throttle import Throttle, catalogue
from ..problem.free_parameters import Form, FreeParameters, Layout, Pick
from ..rig.base import RigConfig
from .settings import IdentifiabilitySettings

# ---- How far a fit can be trusted, in a form for every later stage


@dataclass(frozen=True)
class FitState:
    """The state in which a fit ended."""

    chi2_per_dof: float  # chi2 per degree of freedom of its residual
    # converged, reason: whether the end is an optimum, and in words why (not)
    converged: bool
    reason: str
    compromise: str | None  # why its parameters are no estimates; None if they are

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions for every result made from this fit, one sentence each; none if the fit is sound."""
        unfinished = () if self.converged else (f"The fit behind this did NOT CONVERGE: {self.reason}.",)
        if self.compromise is None:
            return unfinished
        return (*unfinished, f"The parameters behind this are a compromise, not estimates: {self.compromise}.")


SOUND = FitState(1.0, True, "", None)
"""State of a model that was not fitted."""


# ---- A fitted model for design, reduction and sampling: free parameters, optimum, and its covariance


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its optimum.

    Args:
        config: configuration of the rig.
        free_parameters: the free parameters of the fit.
        x: coordinates at the optimum, shape (P,).
        covariance: covariance of the coordinates, as wide as the stated intervals, shape (P, P).
        identifiability: thresholds above which the fit calls a parameter not known.
        state: state in which the fit ended.
        position_noise: standard deviation of one reading of the rig's position, rad, the median of its traces.
    """

    config: RigConfig
    free_parameters: FreeParameters
    x: np.ndarray
    covariance: np.ndarray
    identifiability: IdentifiabilitySettings = IdentifiabilitySettings()
    state: FitState = SOUND
    position_noise: float = 0.0

    @cached_property
    def values(self) -> dict[str, float]:
        """Value of every parameter, SI, by symbol."""
        return self.free_parameters.values(self.x)

    @property
    def throttle(self) -> Throttle:
        """The model."""
        return Throttle.build(self.free_parameters.layout.types, self.values)

    def doubt(self, symbol: str) -> float:
        """Standard deviation of a parameter's coordinate over its reach, about its relative error; 0 if not free."""
        layout = self.free_parameters.layout
        if symbol not in layout.free:
            return 0.0
        k = layout.free.index(symbol)
        variance = float(self.covariance[k, k])
        return math.sqrt(variance) / float(layout.reach(self.x)[k]) if variance >= 0.0 else math.inf

    def throttles(self, x: np.ndarray) -> Throttle:
        """Models at many coordinates, shape (D, P): one whose parameters have shape (D,)."""
        return Throttle.build(self.free_parameters.layout.types, self.values_at(x))

    def values_at(self, x: np.ndarray) -> dict[str, Any]:
        """Values of every parameter, SI, by symbol, at many coordinates, shape (D, P): shape (D,) each."""
        layout = self.free_parameters.layout
        return _values_at(layout.form, layout.padded(x), layout.pick(self.free_parameters.held))

    def laplace(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Coordinates drawn from the normal distribution of the fit, shape (count, P).

        In a direction that the data do not determine, the standard deviation is limited to a hundred percent.
        """
        reach = self.free_parameters.layout.reach(self.x)
        spread = np.nan_to_num(self.covariance / np.outer(reach, reach), posinf=1.0, neginf=0.0)
        variance, directions = np.linalg.eigh(0.5 * (spread + spread.T))
        sd = np.sqrt(np.clip(variance, 0.0, 1.0))
        return self.x + reach * ((rng.standard_normal((count, self.x.size)) * sd) @ directions.T)

    def coordinates(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Coordinates of many values in SI by symbol, shape (D,) each; shape (D, P)."""
        layout = self.free_parameters.layout
        rows = zip(*(np.asarray(values[s]).tolist() for s in layout.free), strict=True)
        return np.array([layout.coordinates(dict(zip(layout.free, row, strict=True))) for row in rows])

    def value_and_gradient(self, function: Any) -> tuple[np.ndarray, np.ndarray]:
        """`function(values)`, values in SI by symbol, at x, and its derivative by the coordinates, shape (..., P)."""
        layout = self.free_parameters.layout
        pick = layout.pick(self.free_parameters.held)

        def twice(x: Any) -> tuple[Any, Any]:
            value = function(layout.form.values(x, pick))
            return value, value

        slope, value = compiled_quickly(jax.jacfwd(twice, has_aux=True))(layout.padded(self.x))
        return np.asarray(value), np.asarray(slope)[..., : self.x.size]


@partial(jax.jit, static_argnums=0)
def _values_at(form: Form, x: Any, pick: Pick) -> dict[str, Any]:
    """Values at many coordinates; compiled once for a model and a number of coordinates, not at each call."""
    return jax.vmap(form.values, in_axes=(0, None))(x, pick)


# ---- How the units of a design scatter, estimated from a fleet: the distribution of a future unit
#
#     theta_j = mean_j exp(s_j t_j - s_j^2 / 2)   if positive,     theta_j = mean_j + r_j t_j   otherwise
#     r_j^2 = sd_j^2 + stderr_j^2,   s_j^2 = log(1 + r_j^2 / mean_j^2),    t ~ t_(U-1)(0, R)
#
# It is wider than the units' scatter, because mean, sd and R are estimated from only U units.
#
# Source: Gelman et al. 2013, Bayesian Data Analysis, section 3.6. Differs from source: U - 1 degrees of freedom
# for any number of parameters, as for each of them alone; errors of the means are assumed to be correlated as the units
# are.


@dataclass(frozen=True, eq=False)
class PopulationLaw:
    """Distribution of P parameters or sums of them, SI."""

    symbols: tuple[str, ...]  # P symbols
    mean: Float[np.ndarray, " P"]  # mean over units, shape (P,)
    sd: Float[np.ndarray, " P"]  # standard deviation between units, without their own uncertainty, shape (P,)
    stderr: Float[np.ndarray, " P"]  # standard error of the mean, shape (P,)
    correlation: Float[np.ndarray, "P P"]  # R, between units, shape (P, P); 0 for a parameter without spread
    positive: Bool[np.ndarray, " P"]  # whether a parameter cannot be negative, shape (P,)
    units: int  # U, the number of units behind the estimate; 2 or more

    @classmethod
    def of_units(cls, values: Mapping[str, np.ndarray], positive: Mapping[str, bool]) -> PopulationLaw:
        """The law from units whose values are known exactly.

        Args:
            values: SI by symbol, shape (U,).
            positive: whether a parameter cannot be negative, by symbol.
        """
        every = np.array(list(values.values()), dtype=float)
        count = every.shape[1]
        sd = every.std(axis=1, ddof=1)
        alike = every - every.mean(axis=1, keepdims=True)
        size = np.where(sd > 0.0, sd, 1.0)
        correlation = alike @ alike.T / (count - 1) / np.outer(size, size)
        np.fill_diagonal(correlation, 1.0)
        return cls(tuple(values), every.mean(axis=1), sd, sd / np.sqrt(count), correlation,
                   np.array([positive[symbol] for symbol in values]), count)  # fmt: skip

    def drawn(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """`count` random units, SI by symbol, shape (count,)."""
        value, vector = np.linalg.eigh(self.correlation)
        normal = rng.standard_normal((count, len(self.symbols))) @ (vector * np.sqrt(np.maximum(value, 0.0))).T
        degrees = self.units - 1
        t = normal * np.sqrt(degrees / rng.chisquare(degrees, count))[:, None]
        wide = np.hypot(self.sd, self.stderr)
        log = self.positive & (self.mean > 0.0)
        s = np.sqrt(np.log1p((wide / np.where(log, self.mean, np.inf)) ** 2))
        drawn = np.where(log, self.mean * np.exp(s * t - 0.5 * s**2), self.mean + wide * t)
        return dict(zip(self.symbols, drawn.T, strict=True))


# ---- Many units of one design as one model: the common part, and the parameters' values unit by unit

SUMS = {"J_m": ("J_eq", "J_L"), "B_m": ("B_eq", "B_L")}  # motor's part: (sum at the plate, plate's part)
_LEAST = 1e-3  # share of a positive parameter's usual size, for a unit whose estimate is not positive


@dataclass(frozen=True, eq=False)
class FleetModel:
    """Units that differ only in their values; made by `fleet_model`."""

    config: RigConfig  # configuration of the rig, common to all
    free_parameters: FreeParameters  # free parameters of the model, common to all
    units: tuple[str, ...]  # U names
    values: Mapping[str, Float[np.ndarray, " U"]]  # values of every parameter, SI, by symbol, shape (U,)
    position_noise: float = 0.0  # standard deviation of one reading of the rig's position, rad
    # their population, without their own uncertainty; None if only the units are known
    population: PopulationLaw | None = None

    @cached_property
    def types(self) -> tuple[type[AbstractEffect], ...]:
        """Effects of the throttle body itself: without rig and ECU."""
        return body_types(self.free_parameters.layout)

    @cached_property
    def law(self) -> PopulationLaw:
        """Distribution of future units; if the population is not known, from the scatter of the units."""
        if self.population is not None:
            return self.population
        layout = self.free_parameters.layout
        positive = {s: not isinstance(layout.parameter(s).domain, Real) for s in layout.free}
        return PopulationLaw.of_units({s: self.values[s] for s in layout.free}, positive)

    @cached_property
    def identifiable_symbols(self) -> tuple[str, ...]:
        """Parameters that the law covers, including both parts of a sum and parameters tied to them."""
        named = set(self.law.symbols)
        for motor, (whole, plate) in SUMS.items():
            named |= {motor, plate} if named & {motor, whole, plate} else set()
        named |= {symbol for symbol, other in self.free_parameters.layout.ties if other in named}
        return tuple(symbol for symbol in self.values if symbol in named)

    def future(self, count: int, rng: np.random.Generator) -> FleetModel:
        """`count` future units, "future 1" ...; parameters that the law does not cover have the mean unit's values."""
        free = self.free_parameters.layout.free
        mean = {symbol: np.full(count, self.mean[symbol]) for symbol in free}
        drawn = split_sums(self.law.drawn(count, rng), {s: self.values[s] for s in free}, self.config.gear_ratio)
        names = [f"future {k + 1}" for k in range(count)]
        return fleet_model(self.config, self.free_parameters, names, mean | drawn, self.position_noise)

    @property
    def throttles(self) -> Throttle:
        """All units as one model, whose parameters have shape (U,)."""
        return Throttle.build(self.types, self.values)

    @cached_property
    def mean(self) -> dict[str, float]:
        """Mean of every parameter over the units, SI."""
        return {symbol: float(np.mean(values)) for symbol, values in self.values.items()}

    def taking(self, which: np.ndarray) -> FleetModel:
        """Some of the units, by their numbers, shape (C,)."""
        some = {symbol: values[which] for symbol, values in self.values.items()}
        return replace(self, units=tuple(self.units[k] for k in which.tolist()), values=some)

    @cached_property
    def coordinates(self) -> Float[np.ndarray, "U P"]:
        """Coordinates of the free parameters, unit by unit."""
        layout = self.free_parameters.layout
        rows = zip(*(self.values[s].tolist() for s in layout.free), strict=True)
        return np.array([layout.coordinates(dict(zip(layout.free, row, strict=True))) for row in rows])

    @property
    def nominal(self) -> Fitted:
        """The mean unit, as uncertain as units differ, for functions that take one fitted model."""
        layout, x = self.free_parameters.layout, self.coordinates
        spread = np.cov(x.T).reshape(len(layout.free), -1) if len(x) > 1 else np.zeros((x.shape[1],) * 2)
        middle = layout.coordinates(self.mean)
        return Fitted(self.config, self.free_parameters, middle, spread, position_noise=self.position_noise)


def body_types(layout: Layout) -> tuple[type[AbstractEffect], ...]:
    """Effects of the throttle body itself: without rig and ECU."""
    return tuple(t for t in layout.types if not issubclass(t, AbstractRigEffect) and not t.commands)


def split_sums(
    known: Mapping[str, np.ndarray], own: Mapping[str, np.ndarray], gear_ratio: float
) -> dict[str, np.ndarray]:
    """Values of a model's own parameters, if only the sum over motor and plate is known.

    The parts keep their shares of the sum in the median of the units: no data determine these shares, and no measurable
    quantity depends on them.

    Args:
        known: SI by symbol, including sums (`SUMS`), shape (D,).
        own: values of units, by symbol of the model, shape (U,).
        gear_ratio: N.
    """
    values = {symbol: value for symbol, value in known.items() if symbol in own}
    for motor, (whole, plate) in SUMS.items():
        if whole in known and motor in own and plate in own:
            share = float(np.median(own[plate] / (gear_ratio**2 * own[motor] + own[plate])))
            values |= {plate: share * known[whole], motor: (1.0 - share) * known[whole] / gear_ratio**2}
    return values


def fleet_model(
    config: RigConfig,
    free_parameters: FreeParameters,
    units: Sequence[str],
    values: Mapping[str, np.ndarray],
    position_noise: float = 0.0,
    population: PopulationLaw | None = None,
) -> FleetModel:
    """Units of one design, from the values of its free parameters; held and tied parameters follow.

    An estimate beyond the bound of its parameter, as estimates without bounds may be, is set to the bound.

    Args:
        config, free_parameters, units, position_noise, population: see `FleetModel`.
        values: SI by symbol, shape (U,), of every free parameter; held parameters are optional.
    Raises:
        UsageError: no unit, a free parameter without values, or a value that is not a number.
    """
    layout, count = free_parameters.layout, len(units)
    if not count:
        raise UsageError("a fleet without a unit has no model. Fit units first.")
    if missing := [symbol for symbol in layout.free if symbol not in values]:
        raise UsageError(f"no values of {', '.join(missing)}, which is free in this model. Give one for each unit.")
    held = {s: np.full(count, float(v)) for s, v in zip(layout.held, free_parameters.held, strict=True)}
    known = catalogue(layout.types)
    every = held | {s: _bounded(layout.parameter(s), np.asarray(v, dtype=float), count)
                    for s, v in values.items() if s in known}  # fmt: skip
    every |= {symbol: every[other] for symbol, other in layout.ties}
    return FleetModel(config, free_parameters, tuple(units), every, position_noise, population)


def _bounded(parameter: Parameter, values: np.ndarray, count: int) -> np.ndarray:
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise UsageError(f"{parameter.symbol} of the fleet has shape {values.shape} and {np.sum(~np.isfinite(values))} "
                         f"values that are not numbers. It must have one number for each of {count} units: leave out "
                         "the units that have none.")  # fmt: skip
    if isinstance(parameter.domain, NonNegative):
        return np.maximum(values, 0.0)
    return np.maximum(values, _LEAST * parameter.domain.scale) if isinstance(parameter.domain, Positive) else values
