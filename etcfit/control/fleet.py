"""Designs gains for the units of a fleet, and for one unit's model with the other parts of its design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import UsageError
from ..estimation.fitted_model import Fitted, FleetModel, body_types
from ..model.throttle import Throttle
from .judged import Tuned, unit_by_unit
from .on_units import OneByOne, OnParts, PartsVerdict
from .pid import Gains, Refusal, Task
from .pid.conditions import Conditions, corners, scattered, under
from .pid.optimal import best_over_draws, optimal
from .settings import FleetDesignSettings

FEWEST_UNITS = 5  # least number of units from which a population is drawn
EVERY_UNIT = FleetDesignSettings()
AT_ONCE = 200  # units whose responses are in memory together
DIRECTIONS = 6  # principal directions of the units' scatter, each of which gives its two extreme units
REFINEMENTS = 3  # most repeated searches with failing units added, where too many fail


@dataclass(eq=False)
class SearchOverUnits:
    """The rule `optimal` over units: repeated with failing units added until enough units meet every requirement."""

    plants: Throttle  # all units, parameters of shape (U,)
    units: tuple[str, ...]  # their names
    settings: FleetDesignSettings  # settings of the search
    made: int = field(default=0)  # number of searches so far

    def __call__(self, task: Task) -> Gains | Refusal:
        """min mean RMSE, subject to requirements met by enough units; otherwise the gains with which most units do."""
        rng = np.random.default_rng(self.settings.seed)
        gains, self.made = optimal(task), 1
        if isinstance(gains, Refusal):
            return gains
        best, found = gains, one_by_one(task, self.plants, self.units, gains)
        latest = found
        for _ in range(REFINEMENTS):
            if found.met.mean() >= self.settings.share:
                break
            task = self._with(task, latest.worst_first[: max(1, self.settings.few // 3)])
            gains = best_over_draws(task, np.log([best, gains]), rng)
            latest = one_by_one(task, self.plants, self.units, gains)
            self.made += 1
            if latest.met.mean() > found.met.mean():
                best, found = gains, latest
        return best

    def _with(self, task: Task, worst: np.ndarray) -> Task:
        """The task with some units inserted after the nominal one, before those that the search used so far."""
        loop = task.loop
        failing = replace(loop, throttles=self.plants, drive=None, ceiling=None).taking(worst).throttles
        before = loop.taking(np.arange(1, loop.draws - worst.size)).throttles
        return replace(task, loop=replace(loop, throttles=united(loop.first(1).throttles, failing, before)))


def united(*throttles: Throttle) -> Throttle:
    """Models one after another, parameters of shape (D,) each."""
    import jax

    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(each) for each in leaves]), *throttles)


def one_by_one(task: Task, plants: Throttle, units: tuple[str, ...], gains: Gains) -> OneByOne:
    """The results of one set of gains on every unit (parameters of shape (U,)), computed in groups of `AT_ONCE`."""
    one = Gains.stacked(gains)
    return unit_by_unit(task, replace(task.loop, throttles=plants), units, one, AT_ONCE)[0]


def representatives(x: np.ndarray, count: int, settings: FleetDesignSettings) -> np.ndarray:
    """Numbers of the units that the search uses first, `count` at most: extremes, then random ones.

    The extremes are the two ends of each of the first principal directions of the units' scatter.

    Args:
        x: coordinates, shape (U, P).
    """
    off = x - x.mean(axis=0)
    _, _, directions = np.linalg.svd(off, full_matrices=False)
    along = off @ directions[:DIRECTIONS].T
    extreme = np.stack((np.argmin(along, axis=0), np.argmax(along, axis=0)), axis=1).ravel()
    random = np.random.default_rng(settings.seed).permutation(len(x))
    return np.array(list(dict.fromkeys([*extreme.tolist(), *random.tolist()])), dtype=int)[:count]


def future_units(model: FleetModel, settings: FleetDesignSettings = EVERY_UNIT) -> FleetModel | None:
    """Future units, drawn from the population; None where there are too few units to estimate their scatter."""
    if model.law.units < FEWEST_UNITS:
        return None
    return model.future(settings.future, np.random.default_rng(settings.seed + 1))


_ALIKE = 1e-3  # relative, within which two gear ratios are the same


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of one design, from a fleet: measured units, and their population."""

    where: str  # run folder of the fleet
    name: str  # of the fleet
    model: FleetModel  # the ordinary measured units, with the distribution of their population
    left_out: Mapping[str, str]  # the other units, by name, with the reason

    def of_run(self, fitted: Fitted) -> tuple[str, ...]:
        """Parameters of a model that the fleet does not determine."""
        return tuple(symbol for symbol in fitted.values if symbol not in self.model.identifiable_symbols)

    def measured(self, fitted: Fitted) -> Throttle:
        """Each unit as a plant of a model; parameters that the fleet does not determine have the model's values."""
        return self._plants(fitted, self.model, np.tile(fitted.x, (len(self.model.units), 1)))

    def drawn(self, fitted: Fitted, rest: np.ndarray, seed: int) -> Throttle:
        """Future units as plants of a model.

        Args:
            rest: coordinates of the model, a row for each unit, for parameters that the fleet does not determine, shape
                (D, P).
        """
        return self._plants(fitted, self.model.future(len(rest), np.random.default_rng(seed)), rest)

    def _plants(self, fitted: Fitted, units: FleetModel, rest: np.ndarray) -> Throttle:
        known = {symbol: units.values[symbol] for symbol in self.model.identifiable_symbols if symbol in fitted.values}
        return Throttle.build(fitted.free_parameters.layout.types, fitted.values_at(rest) | known)

    def must_be_of(self, fitted: Fitted) -> None:
        """Refuse a model of another design, because its parameters have another meaning.

        Raises:
            UsageError: other effects, or another gear.
        """
        mine, theirs = body_types(fitted.free_parameters.layout), self.model.types
        alone = [_names(have, lack) for have, lack in ((mine, theirs), (theirs, mine))]
        if any(alone):
            found = " and ".join(f"{who} alone {names}" for who, names in
                                 zip(("the run has", "the fleet has"), alone, strict=True) if names)  # fmt: skip
            raise UsageError(f"{self.where}: {found}. Both must have the same effects, because the meaning of a "
                             "parameter depends on them. Name them in [model] effects of fleet.toml or rig.toml, and "
                             "run `etcfit fleet` or `etcfit fit` again.")  # fmt: skip
        gears = self.model.config.gear_ratio, fitted.config.gear_ratio
        if abs(gears[0] - gears[1]) > _ALIKE * abs(gears[1]):
            raise UsageError(f"{self.where}: gear_ratio is {gears[0]:g} in the fleet and {gears[1]:g} in the run, so "
                             "they are of different designs: give the fleet of this throttle.")  # fmt: skip


def _names(have: tuple[type, ...], lack: tuple[type, ...]) -> str:
    return ", ".join(effect.name for effect in have if effect not in lack)  # type: ignore[attr-defined]


def best_for_parts(task: Task, plants: Throttle) -> Gains | Refusal:
    """The rule `optimal` over drawn units, repeated with failing ones until the share `certain` meets everything.

    Args:
        plants: drawn units, parameters of shape (D,).
    """
    optimum, names = task.settings.optimum, _drawn(task.loop.draws - 1)
    settings = FleetDesignSettings(share=optimum.certain, few=optimum.few)
    return SearchOverUnits(plants, names, settings)(sought_over(task, plants))


def _drawn(count: int) -> tuple[str, ...]:
    return tuple(f"drawn {k + 1}" for k in range(count))


def sought_over(task: Task, plants: Throttle) -> Task:
    """The task with these plants, of shape (D,), after the nominal one in place of its own."""
    return replace(task, loop=replace(task.loop, throttles=united(task.loop.first(1).throttles, plants)))


def fare_on_parts(
    task: Task, fitted: Fitted, tuned: Mapping[str, Tuned], proposed: Gains, parts: Parts, future: Throttle
) -> PartsVerdict:
    """The results of every rule's gains on measured and drawn units (`future`), and of the proposed gains under the
    conditions of a car."""
    units, ranges = parts.model.units, task.settings.conditions
    loop = replace(task.loop, throttles=united(parts.measured(fitted), future))
    count, at_once = len(units), task.loop.draws
    names = (*units, *_drawn(loop.draws - count))
    have = {name: each.gains for name, each in tuned.items() if each.gains is not None}
    columns = Gains.stacked(*have.values())
    own, rest = np.arange(count), np.arange(count, loop.draws)
    rules = {name: OnParts(each.taking(own), each.taking(rest)) for name, each in
             zip(have, unit_by_unit(task, loop, names, columns, at_once), strict=True)}  # fmt: skip
    ends = corners(ranges)
    here = scattered(ranges, rest.size, np.random.default_rng(ranges.seed))
    there = Conditions(*(np.concatenate((np.tile(end, count), one)) for end, one in zip(ends, here, strict=True)))
    which = np.concatenate((np.repeat(own, ends.supply.size), rest))
    placed = tuple(f"{names[k]} at {supply:.3g} V, {winding:.3g} degrees Celsius, friction {friction:.2g}"
                   for k, supply, winding, friction in
                   zip(which.tolist(), *(each.tolist() for each in there), strict=True))  # fmt: skip
    one = Gains.stacked(proposed)
    outside = unit_by_unit(task, under(loop.taking(which), there, ranges), placed, one, at_once)[0]
    at_corners = np.arange(which.size - rest.size)
    return PartsVerdict(parts.where, parts.name, parts.of_run(fitted), parts.left_out, rules,
                        outside.taking(at_corners), outside.taking(np.arange(at_corners.size, which.size)))  # fmt: skip
