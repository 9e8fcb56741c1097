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

# ---- How far a fit can be believed, in a form that every later stage carries


@dataclass(frozen=True)
class FitState:
    """The state in which a fit ended.

    Args:
        chi2_per_dof: of its residual.
        converged, reason: whether at an optimum, and in words why (not).
        compromise: why its parameters are no estimates; None where they are.
    """

    chi2_per_dof: float
    converged: bool
    reason: str
    compromise: str | None

    @property
    def cautions(self) -> tuple[str, ...]:
        """What a reader of anything made from it must know, a sentence each; none of a sound fit."""
        unfinished = () if self.converged else (f"The fit behind this did NOT CONVERGE: {self.reason}.",)
        if self.compromise is None:
            return unfinished
        return (*unfinished, f"The parameters behind this are a compromise, not estimates: {self.compromise}.")


SOUND = FitState(1.0, True, "", None)
"""Of a model that nobody had to fit."""


# ---- A fitted model for design, reduction and sampling: what was free, where the fit ended, how well that is known


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its optimum.

    Args:
        config: of the rig.
        free_parameters: what was free in it.
        x: coordinates at the optimum, shape (P,).
        covariance: of the coordinates, as wide as their intervals are stated, shape (P, P).
        identifiability: by what the fit called a parameter not known.
        state: in which its fit ended.
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
        """Of every parameter, SI, by symbol."""
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
        """Of every parameter, SI, by symbol, at many coordinates, shape (D, P): shape (D,) each."""
        layout = self.free_parameters.layout
        return _values_at(layout.form, layout.padded(x), layout.pick(self.free_parameters.held))

    def laplace(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Coordinates drawn from the normal distribution of the fit, shape (count, P).

        A direction that the data leave open is drawn no wider than a hundred percent.
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
    """Values at many coordinates; compiled once for a model and a number of them, not at each call."""
    return jax.vmap(form.values, in_axes=(0, None))(x, pick)


# ---- How the units of a design scatter, as far as a fleet tells: the law of a unit that is not made yet
#
#     theta_j = mean_j exp(s_j t_j - s_j^2 / 2)   of what is positive,     theta_j = mean_j + r_j t_j   of the rest
#     r_j^2 = sd_j^2 + stderr_j^2,   s_j^2 = log(1 + r_j^2 / mean_j^2),    t ~ t_(U-1)(0, R)
#
# Wider than the units, for mean, sd and R are known from U units only.
#
# Source: Gelman et al. 2013, Bayesian Data Analysis, section 3.6. Differs from source: U - 1 degrees of freedom
# whatever the number of parameters, as for each of them alone; errors of the means are taken to go together as the
# units do.


@dataclass(frozen=True, eq=False)
class PopulationLaw:
    """Of P parameters or sums of them, SI.

    Args:
        symbols: P of them.
        mean: between units, shape (P,).
        sd: between units, their own uncertainty taken off, shape (P,).
        stderr: of the mean, shape (P,).
        correlation: R, between units, shape (P, P); 0 beside what has no spread.
        positive: what cannot be negative, shape (P,).
        units: U, from which all this is known; 2 or more.
    """

    symbols: tuple[str, ...]
    mean: Float[np.ndarray, " P"]
    sd: Float[np.ndarray, " P"]
    stderr: Float[np.ndarray, " P"]
    correlation: Float[np.ndarray, "P P"]
    positive: Bool[np.ndarray, " P"]
    units: int

    @classmethod
    def of_units(cls, values: Mapping[str, np.ndarray], positive: Mapping[str, bool]) -> PopulationLaw:
        """That of units whose values are known exactly.

        Args:
            values: SI by symbol, shape (U,).
            positive: by symbol.
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
        """So many units, SI by symbol, shape (count,)."""
        value, vector = np.linalg.eigh(self.correlation)
        normal = rng.standard_normal((count, len(self.symbols))) @ (vector * np.sqrt(np.maximum(value, 0.0))).T
        degrees = self.units - 1
        t = normal * np.sqrt(degrees / rng.chisquare(degrees, count))[:, None]
        wide = np.hypot(self.sd, self.stderr)
        log = self.positive & (self.mean > 0.0)
        s = np.sqrt(np.log1p((wide / np.where(log, self.mean, np.inf)) ** 2))
        drawn = np.where(log, self.mean * np.exp(s * t - 0.5 * s**2), self.mean + wide * t)
        return dict(zip(self.symbols, drawn.T, strict=True))


# ---- Many units of one design as one model: what is common, and the parameters' values unit by unit

SUMS = {"J_m": ("J_eq", "J_L"), "B_m": ("B_eq", "B_L")}  # motor's part: (sum at the plate, plate's part)
_LEAST = 1e-3  # of a positive parameter's usual size, for a unit whose estimate has none


@dataclass(frozen=True, eq=False)
class FleetModel:
    """Units that differ in their values alone; made by `fleet_model`.

    Args:
        config: of the rig, common to all.
        free_parameters: of the model, common to all.
        units: names, U of them.
        values: of every parameter, SI, by symbol, shape (U,).
        position_noise: standard deviation of one reading of the rig's position, rad.
        population: that they are from, their own uncertainty taken off; None where only the units are known.
    """

    config: RigConfig
    free_parameters: FreeParameters
    units: tuple[str, ...]
    values: Mapping[str, Float[np.ndarray, " U"]]
    position_noise: float = 0.0
    population: PopulationLaw | None = None

    @cached_property
    def types(self) -> tuple[type[AbstractEffect], ...]:
        """Effects of the throttle body itself: without rig and ECU."""
        return body_types(self.free_parameters.layout)

    @cached_property
    def law(self) -> PopulationLaw:
        """Of units not made yet; where the population is not known, by the scatter of the units as they are."""
        if self.population is not None:
            return self.population
        layout = self.free_parameters.layout
        positive = {s: not isinstance(layout.parameter(s).domain, Real) for s in layout.free}
        return PopulationLaw.of_units({s: self.values[s] for s in layout.free}, positive)

    @cached_property
    def identifiable_symbols(self) -> tuple[str, ...]:
        """Parameters that the law speaks of: both parts of a sum, and what is tied to them, among them."""
        named = set(self.law.symbols)
        for motor, (whole, plate) in SUMS.items():
            named |= {motor, plate} if named & {motor, whole, plate} else set()
        named |= {symbol for symbol, other in self.free_parameters.layout.ties if other in named}
        return tuple(symbol for symbol in self.values if symbol in named)

    def future(self, count: int, rng: np.random.Generator) -> FleetModel:
        """So many units not made yet, "future 1" ...; what the law does not speak of is that of the mean unit."""
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
        """Of every parameter over the units, SI."""
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
        """The mean unit, known as badly as units differ: for all that takes one fitted model."""
        layout, x = self.free_parameters.layout, self.coordinates
        spread = np.cov(x.T).reshape(len(layout.free), -1) if len(x) > 1 else np.zeros((x.shape[1],) * 2)
        middle = layout.coordinates(self.mean)
        return Fitted(self.config, self.free_parameters, middle, spread, position_noise=self.position_noise)


def body_types(layout: Layout) -> tuple[type[AbstractEffect], ...]:
    """Effects of the throttle body itself: without rig and ECU."""
    return tuple(t for t in layout.types if not issubclass(t, AbstractRigEffect) and not t.commands)


def split_sums(
    told: Mapping[str, np.ndarray], own: Mapping[str, np.ndarray], gear_ratio: float
) -> dict[str, np.ndarray]:
    """Values of a model's own parameters, where of motor and plate only a sum is told.

    They keep the shares of it that they have in the middle of the units: no data speak of them, and nothing that a rig
    or a car shows depends on them.

    Args:
        told: SI by symbol, sums (`SUMS`) among them, shape (D,).
        own: of units, by symbol of the model, shape (U,).
        gear_ratio: N.
    """
    values = {symbol: value for symbol, value in told.items() if symbol in own}
    for motor, (whole, plate) in SUMS.items():
        if whole in told and motor in own and plate in own:
            share = float(np.median(own[plate] / (gear_ratio**2 * own[motor] + own[plate])))
            values |= {plate: share * told[whole], motor: (1.0 - share) * told[whole] / gear_ratio**2}
    return values


def fleet_model(
    config: RigConfig,
    free_parameters: FreeParameters,
    units: Sequence[str],
    values: Mapping[str, np.ndarray],
    position_noise: float = 0.0,
    population: PopulationLaw | None = None,
) -> FleetModel:
    """Units of one design by the values of what is free in it; what is held or tied follows.

    An estimate beyond the bound of its parameter, as estimates without bounds may be, is taken to the bound.

    Args:
        config, free_parameters, units, position_noise, population: see `FleetModel`.
        values: SI by symbol, shape (U,); every free parameter must be among them, held ones may be.
    Raises:
        UsageError: no unit, a free parameter without values, or a value that is no number.
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
                         f"values that are no numbers. It must have one number for each of {count} units: leave out "
                         "the units that have none.")  # fmt: skip
    if isinstance(parameter.domain, NonNegative):
        return np.maximum(values, 0.0)
    return np.maximum(values, _LEAST * parameter.domain.scale) if isinstance(parameter.domain, Positive) else values
