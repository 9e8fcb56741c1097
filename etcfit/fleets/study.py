"""What the units of a fleet tell together: population, odd units, drift, capability, gauge, effects, and the line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..estimation.fleet_model import FleetModel, fleet_model, parted
from ..problem.free_parameters import free_parameters
from ..rig.base import RigConfig
from .config import FleetConfig
from .line import FigureResult, measured
from .prediction import Prediction, predict
from .results import Results
from .statistics.capability import Capability, Line, Spec, capability
from .statistics.charts import Chart, chart
from .statistics.drift import Drift, drifts
from .statistics.effects import EffectInFleet, effects_in
from .statistics.gauge import Gauge, Labels, gauge
from .statistics.odd import OddUnit, odd_units
from .statistics.population import Population, population
from .statistics.robust import robust
from .statistics.scaled import scaled
from .statistics.settings import FleetSettings
from .statistics.shrunk import Shrunk, shrink
from .statistics.stack import Stack, stacked
from .unit import FailedUnit, UnitResult


@dataclass(frozen=True, eq=False)
class Series:
    """A chart, of the units whose own data tell the symbol.

    Args:
        units: in the order of the fleet.
        value, stderr: their own, SI, shape (N,).
        chart: of them.
    """

    units: tuple[str, ...]
    value: Float[np.ndarray, " N"]
    stderr: Float[np.ndarray, " N"]
    chart: Chart


@dataclass(frozen=True, eq=False)
class FleetStudy:
    """Everything that is known of a fleet.

    Args:
        config: what is written down about it.
        fitted, failed: its units, in order.
        population, shrunk: the design, and each unit given the design.
        odd: units unlike the others, most odd first.
        effects: those that the common model names, unit by unit.
        series: control charts by symbol.
        drifts: changes in the order of the fleet; `since` counts within the symbol's series.
        capability: by symbol or figure that has limits.
        gauge: by symbol; empty where no part was measured twice.
        model: the units as models, by their shrunk values; None where the common model has a parameter of which no unit
            has a value.
        figures: what a line measures, by name, unit by unit in the order of `model.units`, odd ones among them.
        predictions: of the ordinary units, the same hot and cold, on a weak battery and a charged one.
        settings: that all of it was decided by.
    """

    config: FleetConfig
    fitted: tuple[UnitResult, ...]
    failed: tuple[FailedUnit, ...]
    population: Population
    shrunk: Shrunk
    odd: tuple[OddUnit, ...]
    effects: tuple[EffectInFleet, ...]
    series: Mapping[str, Series]
    drifts: tuple[Drift, ...]
    capability: Mapping[str, Capability]
    gauge: Mapping[str, Gauge]
    model: FleetModel
    figures: Mapping[str, FigureResult]
    predictions: tuple[Prediction, ...]
    settings: FleetSettings

    @property
    def synthetic(self) -> bool:
        """Whether any unit says so."""
        return any(unit.synthetic for unit in self.fitted)


def study(
    config: FleetConfig, rig: RigConfig, results: Results, settings: FleetSettings = FleetSettings()
) -> FleetStudy:
    """Study the units that have a result.

    Args:
        config: of the fleet.
        rig: of one unit; the others' differ in no more than their names.
        results: of the fits.
        settings: all that it decides by.
    """
    units = results.fitted
    stack = stacked(robust(units, settings.most_widening))
    found, odd = without_odd(stack, units, config.shared, settings)
    shrunk = shrink(stacked(robust(units, settings.most_drawn)), found, settings)
    series = _series(stack, found, settings)
    seen = {symbol: _over_all(each, stack.units) for symbol, each in series.items()}
    model = units_as_models(rig, units, shrunk)
    figures = measured(model)
    ordinary = np.flatnonzero(~np.isin(model.units, [unit.unit for unit in odd]))
    return FleetStudy(
        config=config,
        fitted=units,
        failed=results.failed,
        population=found,
        shrunk=shrunk,
        odd=odd,
        effects=effects_in(stack, rig.effects, settings),
        series=series,
        drifts=drifts(seen, settings.charts),
        capability=_capable(config, found, figures, ordinary, settings),
        gauge=_gauge(config, stack.units, seen),
        model=model,
        figures=figures,
        predictions=predict(model.taking(ordinary)),
        settings=settings,
    )


def without_odd(
    stack: Stack, units: tuple[UnitResult, ...], shared: tuple[str, ...], settings: FleetSettings
) -> tuple[Population, tuple[OddUnit, ...]]:
    """The population of the ordinary units, and the odd ones.

    A unit whose traces its model does not explain may lie among the others by its parameters, and is still no measure
    of the design: it is left out, and the population is estimated again, as often as another unit shows.
    """
    kept = np.ones(len(units), dtype=bool)
    for _ in range(settings.population.rounds):
        found = population(stack.only(kept), shared, settings)
        odd = odd_units(stack, found, units, settings)
        again = ~np.isin(stack.units, [unit.unit for unit in odd])
        if np.array_equal(again, kept) or again.sum() < settings.population.fewest * len(units):
            break
        kept = again
    return found, odd


def units_as_models(rig: RigConfig, units: tuple[UnitResult, ...], shrunk: Shrunk) -> FleetModel:
    """Every unit by its shrunk values; what the fleet does not tell as the unit's own fit has it."""
    known = free_parameters(rig)
    own = {symbol: np.array([unit.parameters[symbol].value for unit in units]) for symbol in known.layout.free}
    told = {symbol: shrunk.estimate[:, k] for k, symbol in enumerate(shrunk.symbols)}
    values = own | parted(told, own, rig.gear_ratio)
    return fleet_model(rig, known, [unit.unit for unit in units], values, rig.noise.get("position", 0.0))


def _series(stack: Stack, found: Population, settings: FleetSettings) -> dict[str, Series]:
    """A chart of each symbol whose value differs from unit to unit, where two units or more tell it."""
    out = {}
    own = scaled(stack.marginal(found.symbols), settings.population.null)
    stderr = np.sqrt(own.variance) * own.scale
    for k, symbol in enumerate(found.symbols):
        told = own.tells[:, k]
        if found.shared[k] or told.sum() < 2:
            continue
        value, error = own.stack.estimate[told, k], stderr[told, k]
        units = tuple(unit for unit, known in zip(stack.units, told, strict=True) if known)
        out[symbol] = Series(units, value, error, chart(value, error, settings.charts))
    return out


def _over_all(series: Series, units: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Value and standard error for every unit, NaN where its own data do not tell."""
    place = {unit: k for k, unit in enumerate(units)}
    value, stderr = np.full(len(units), np.nan), np.full(len(units), np.nan)
    at = [place[unit] for unit in series.units]
    value[at], stderr[at] = series.value, series.stderr
    return value, stderr


def _capable(
    config: FleetConfig,
    found: Population,
    figures: Mapping[str, FigureResult],
    ordinary: np.ndarray,
    settings: FleetSettings,
) -> dict[str, Capability]:
    out = {}
    for name, limit in config.limits.items():
        low, high = (end if np.isfinite(end) else None for end in (limit.low, limit.high))
        if name in found.symbols and not found.shared[found.symbols.index(name)]:
            line = Line.of(found, name)
        elif name in figures and np.isfinite(figures[name].value).sum() > 1:
            value = figures[name].value[ordinary]
            line = Line.of_values(value, np.zeros_like(value), settings)
        else:
            continue
        out[name] = capability(line, Spec(low, high), settings.population.level)
    return out


def _gauge(
    config: FleetConfig, units: tuple[str, ...], seen: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> dict[str, Gauge]:
    members = [config.members[unit] for unit in units]
    labels = Labels(*(tuple(getattr(member, name) for member in members) for name in ("part", "rig", "operator")))
    found = {symbol: gauge(value, labels) for symbol, (value, _) in seen.items()}
    return {symbol: each for symbol, each in found.items() if each is not None}
