"""Many units of one design as one model: what is common, and the parameters' values unit by unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..errors import UsageError
from ..model.effects import AbstractEffect
from ..model.parameters import NonNegative, Parameter, Positive, Real
from ..model.rig_effects import AbstractRigEffect
from ..model.throttle import Throttle, catalogue
from ..problem.free_parameters import FreeParameters, Layout
from ..rig.base import RigConfig
from .fitted_model import Fitted
from .population_law import PopulationLaw

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
    def told(self) -> tuple[str, ...]:
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
        drawn = parted(self.law.drawn(count, rng), {s: self.values[s] for s in free}, self.config.gear_ratio)
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


def parted(told: Mapping[str, np.ndarray], own: Mapping[str, np.ndarray], gear_ratio: float) -> dict[str, np.ndarray]:
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
