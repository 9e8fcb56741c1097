"""Studies the results of all units together: population, odd units, drift, capability, gauge, effects, and the line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..estimation.fitted_model import FleetModel, fleet_model, split_sums
from ..problem.free_parameters import free_parameters
from ..rig.base import RigConfig
from .config import FleetConfig
from .fitting import Results
from .line import FigureResult, Prediction, measured, predict
from .settings import FleetSettings
from .statistics.capability import Capability, Gauge, Line, capability, gauge
from .statistics.charts import Chart, Drift, chart, drifts
from .statistics.odd import EffectInFleet, OddUnit, effects_in, odd_units
from .statistics.population import LEAST_SHARE, ROUNDS, Population, Shrunk, population, shrink
from .statistics.stack import MOST_WIDENED, MOST_WIDENED_TO_SHRINK, Stack, robust, scaled, stacked
from .unit import FailedUnit, UnitResult


@dataclass(frozen=True, eq=False)
class FleetStudy:
    """All results of a fleet."""

    config: FleetConfig  # content of fleet.toml and units.csv
    # fitted, failed: its units, in order
    fitted: tuple[UnitResult, ...]
    failed: tuple[FailedUnit, ...]
    # population, shrunk: the design, and each unit given the design
    population: Population
    shrunk: Shrunk
    odd: tuple[OddUnit, ...]  # units unlike the others, most odd first
    effects: tuple[EffectInFleet, ...]  # effects that the common model names, unit by unit
    charts: Mapping[str, Chart]  # by symbol, of the units whose own data determine it
    drifts: tuple[Drift, ...]  # changes in the order of the fleet; `since` counts in `fitted`
    capability: Mapping[str, Capability]  # by symbol or figure that has limits
    gauge: Mapping[str, Gauge]  # by symbol; empty where no part was measured twice
    # the units as models, by their shrunk values
    model: FleetModel
    figures: Mapping[str, FigureResult]  # figures of the line, by name, in the order of `model.units`, odd ones too
    predictions: tuple[Prediction, ...]  # figures of the ordinary units hot and cold, on a weak and a charged battery
    settings: FleetSettings  # the settings of the study

    @property
    def synthetic(self) -> bool:
        """Whether any unit is declared as synthetic."""
        return any(unit.synthetic for unit in self.fitted)


def study(
    config: FleetConfig, rig: RigConfig, results: Results, settings: FleetSettings = FleetSettings()
) -> FleetStudy:
    """Study the units that have a result; `rig` is that of one unit, and the others differ from it in name only."""
    units = results.fitted
    stack = stacked(robust(units, MOST_WIDENED))
    found, odd = without_odd(stack, units, config.shared, settings)
    shrunk = shrink(stacked(robust(units, MOST_WIDENED_TO_SHRINK)), found)
    charts = _charts(stack, found)
    in_order = {symbol: _in_order(each, stack.units) for symbol, each in charts.items()}
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
        effects=effects_in(stack, rig.effects, settings.effect_rate),
        charts=charts,
        drifts=drifts(in_order, settings.drift_level),
        capability=_capable(config, found, {name: each.value[ordinary] for name, each in figures.items()}, settings),
        gauge=_gauges(config, stack.units, in_order),
        model=model,
        figures=figures,
        predictions=predict(model.taking(ordinary)),
        settings=settings,
    )


def without_odd(
    stack: Stack, units: tuple[UnitResult, ...], shared: tuple[str, ...], settings: FleetSettings
) -> tuple[Population, tuple[OddUnit, ...]]:
    """The population of the ordinary units, and the odd ones.

    A unit whose model does not explain its traces does not represent the design, even if its parameters are like the
    others': it is left out, and the population is estimated again until no further unit is found.
    """
    kept = np.ones(len(units), dtype=bool)
    for _ in range(ROUNDS):
        found = population(stack.only(kept), shared, settings)
        odd = odd_units(stack, found, units, settings.odd_rate)
        again = ~np.isin(stack.units, [unit.unit for unit in odd])
        if np.array_equal(again, kept) or again.sum() < LEAST_SHARE * len(units):
            break
        kept = again
    return found, odd


def units_as_models(rig: RigConfig, units: tuple[UnitResult, ...], shrunk: Shrunk) -> FleetModel:
    """Every unit by its shrunk values; a parameter that the fleet does not determine has the value of the unit's
    fit."""
    known = free_parameters(rig)
    own = {symbol: np.array([unit.parameters[symbol].value for unit in units]) for symbol in known.layout.free}
    determined = {symbol: shrunk.estimate[:, k] for k, symbol in enumerate(shrunk.symbols)}
    values = own | split_sums(determined, own, rig.gear_ratio)
    return fleet_model(rig, known, [unit.unit for unit in units], values, rig.noise.get("position", 0.0))


def _charts(stack: Stack, found: Population) -> dict[str, Chart]:
    """A chart of each symbol whose value differs from unit to unit, where the data of two units determine it."""
    out = {}
    own = scaled(stack.marginal(found.symbols))
    stderr = np.sqrt(own.variance) * own.scale
    for k, symbol in enumerate(found.symbols):
        determined = own.tells[:, k]
        if not found.shared[k] and determined.sum() >= 2:
            units = tuple(unit for unit, known in zip(stack.units, determined, strict=True) if known)
            out[symbol] = chart(units, own.stack.estimate[determined, k], stderr[determined, k])
    return out


def _in_order(chart: Chart, units: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Value and standard error for every unit, NaN where its own data determine none."""
    value, stderr = np.full(len(units), np.nan), np.full(len(units), np.nan)
    determined = np.isin(units, chart.units)
    value[determined], stderr[determined] = chart.value, chart.stderr
    return value, stderr


def _capable(
    config: FleetConfig, found: Population, figures: Mapping[str, np.ndarray], settings: FleetSettings
) -> dict[str, Capability]:
    """The capability of symbols that differ between units and of figures of the ordinary units, where they have
    limits."""
    out = {}
    for name, limit in config.limits.items():
        if name in found.symbols and not found.shared[found.symbols.index(name)]:
            line = Line.from_population(found, name)
        elif name in figures and np.isfinite(figures[name]).sum() > 1:
            line = Line.from_values(figures[name], np.zeros_like(figures[name]), settings)
        else:
            continue
        out[name] = capability(line, limit.low, limit.high, settings.population.level)
    return out


def _gauges(
    config: FleetConfig, units: tuple[str, ...], in_order: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> dict[str, Gauge]:
    members = [config.members[unit] for unit in units]
    labels = [[getattr(member, name) for member in members] for name in ("part", "rig", "operator")]
    found = {symbol: gauge(value, *labels) for symbol, (value, _) in in_order.items()}
    return {symbol: each for symbol, each in found.items() if each is not None}
