"""Gains for a fleet, and for one unit's model that hold for the parts of its design; how they fare unit by unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..car_log.log import Series
from ..errors import UsageError
from ..estimation.fitted_model import Fitted, FleetModel, body_types
from ..estimation.joint_fit import Report, quiet
from ..model.ecu import Ecu
from ..model.ecus import EcuProfile
from ..model.feed_forward import Asked
from ..model.throttle import Throttle
from .design import BEST, NOTHING, PAPERS, Design, must_be_known, propose, task_of
from .judged import unit_by_unit
from .loop_figures import Requirements
from .on_units import FleetVerdict, OneByOne, OnParts, PartsVerdict
from .pid import RULES, Gains, Refusal, Rule, Task
from .pid.conditions import Conditions, corners, scattered, under
from .pid.optimal import best_over_draws, optimal
from .settings import DesignSettings, FleetDesignSettings

ORIGIN = "fleet"
FEWEST_UNITS = 5  # from which on their scatter is believed
_AT_ONCE = 200  # units whose responses are in memory together
EVERY_UNIT = FleetDesignSettings()
DESIGN = DesignSettings()


@dataclass(eq=False)
class SearchOverUnits:
    """The rule `optimal` over units: searched anew with those that fail until enough of all meet everything.

    Args:
        plants: all units, parameters of shape (U,).
        units: their names.
        asked: of them.
        made: searches so far.
    """

    plants: Throttle
    units: tuple[str, ...]
    asked: FleetDesignSettings
    made: int = field(default=0)

    def __call__(self, task: Task) -> Gains | Refusal:
        """min mean RMSE, subject to requirements met by enough units; else the gains that most units meet them with."""
        rng = np.random.default_rng(self.asked.seed)
        gains, self.made = optimal(task), 1
        if isinstance(gains, Refusal):
            return gains
        best, found = gains, self._tried(task, gains)
        latest = found
        for _ in range(self.asked.refinements):
            if found.met.mean() >= self.asked.share:
                break
            task = self._with(task, latest.worst_first[: max(1, self.asked.few // 3)])
            gains = best_over_draws(task, np.log([best, gains]), rng)
            latest = self._tried(task, gains)
            self.made += 1
            if latest.met.mean() > found.met.mean():
                best, found = gains, latest
        return best

    def _tried(self, task: Task, gains: Gains) -> OneByOne:
        return one_by_one(task, self.plants, self.units, gains, _AT_ONCE)

    def _with(self, task: Task, worst: np.ndarray) -> Task:
        """The same with some units ahead of those that the search saw before, behind the nominal one."""
        loop = task.loop
        failing = replace(loop, throttles=self.plants, drive=None, ceiling=None).taking(worst).throttles
        before = loop.taking(np.arange(1, loop.draws - worst.size)).throttles
        return replace(task, loop=replace(loop, throttles=united(loop.first(1).throttles, failing, before)))


def united(*throttles: Throttle) -> Throttle:
    """Models one after another, parameters of shape (D,) each."""
    import jax

    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(each) for each in leaves]), *throttles)


def design_for_fleet(
    model: FleetModel,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    rule: str = BEST,
    future: FleetModel | None = None,
    feed_forward: Asked = False,
    report: Report = quiet,
    settings: DesignSettings = DESIGN,
    asked: FleetDesignSettings = EVERY_UNIT,
    profile: EcuProfile | None = None,
    log: Series | None = None,
    rules: Mapping[str, Rule] = RULES,
    present: Mapping[str, float] = NOTHING,
) -> Design:
    """Tune by every rule, and propose gains that meet the requirements on nearly all units of a fleet.

    The nominal model is the mean unit. `optimal` is sought over extreme and random units and, where too few of all
    units meet everything with its gains, anew with those that fail among them; of the gains so found the first that
    enough units meet everything with, else those that most do.

    Args:
        model: the units, by their shrunk values.
        ecu, requirements, feed_forward, settings, profile, log, present: see `design.task_of`.
        rule: whose gains are proposed.
        future: units drawn from the population (`future_units`): told apart from the fleet's own; None for none.
        report: called with what is going on and the share done.
        asked: share of the units, and how they are searched over.
        rules: by name, `rule` among them.
    Returns:
        a design whose `fleet` says how the gains fare unit by unit, and whose draws are units.
    Raises:
        UsageError: no such rule, or a rule that has no gains for this plant.
    """
    must_be_known(rule, rules)
    fitted, everyone = model.nominal, model.coordinates
    seen = everyone
    if future is not None and len(everyone) < settings.draws - 1:  # too few to stand for those that will come
        seen = np.vstack((everyone, future.coordinates))
    known = representatives(seen, settings.draws - 1, asked)
    shown = seen[known]
    optimum = replace(settings.optimum, certain=asked.share, few=min(asked.few, len(shown) + 1))
    settings = replace(settings, optimum=optimum)
    task = task_of(fitted, ecu, requirements, shown, feed_forward, settings, profile, log, present)
    plants = fitted.throttles(everyone)
    search = SearchOverUnits(plants, model.units, asked)
    found = propose(fitted, task, rule, {**rules, BEST: search} if BEST in rules else rules, ORIGIN, report)
    report("judging every unit", 0.97)
    gains = found.chosen.gains
    assert gains is not None, "a rule that refused is not proposed"
    own = one_by_one(task, plants, model.units, gains, _AT_ONCE)
    ahead = None
    if future is not None:
        fresh = future.taking(np.setdiff1d(np.arange(len(future.units)), known - len(everyone)))
        ahead = one_by_one(task, fitted.throttles(fresh.coordinates), fresh.units, gains, _AT_ONCE)
    verdict = FleetVerdict(asked, own, None if ahead is None else ahead.share, max(1, search.made))
    return replace(found, fleet=verdict)


def one_by_one(task: Task, plants: Throttle, units: tuple[str, ...], gains: Gains, at_once: int) -> OneByOne:
    """One set of gains on every unit, so many at once.

    Args:
        task: scenarios, ECU and what is asked.
        plants: the units, parameters of shape (U,).
        units: names.
        gains: of the controller.
        at_once: units whose responses are in memory together.
    """
    one = Gains(*(np.array([g]) for g in gains))
    return unit_by_unit(task, replace(task.loop, throttles=plants), units, one, at_once)[0]


def representatives(x: np.ndarray, count: int, asked: FleetDesignSettings) -> np.ndarray:
    """Numbers of so many units at most, those that the search sees first: extremes, then random ones.

    The extremes are the two ends of each of the first principal directions of the units' scatter.

    Args:
        x: coordinates, shape (U, P).
        count: how many at most.
        asked: how many directions, and the seed.
    """
    off = x - x.mean(axis=0)
    _, _, directions = np.linalg.svd(off, full_matrices=False)
    along = off @ directions[: asked.directions].T
    extreme = np.stack((np.argmin(along, axis=0), np.argmax(along, axis=0)), axis=1).ravel()
    random = np.random.default_rng(asked.seed).permutation(len(x))
    return np.array(list(dict.fromkeys([*extreme.tolist(), *random.tolist()])), dtype=int)[:count]


def future_units(model: FleetModel, asked: FleetDesignSettings = EVERY_UNIT) -> FleetModel | None:
    """Units not made yet, drawn from the population; None where there are too few units to say how they scatter.

    Args:
        model: the units measured.
        asked: how many, from how few on, and the seed.
    """
    if model.law.units < FEWEST_UNITS:
        return None
    return model.future(asked.future, np.random.default_rng(asked.seed + 1))


_ALIKE = 1e-3  # relative, within which two gear ratios are the same


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of one design, as a fleet found them: measured units, and the population that they are from.

    Args:
        where: run folder of the fleet.
        name: of the fleet.
        model: the measured units that can be trusted, with the law of their population.
        left_out: the others, by name, with why.
    """

    where: str
    name: str
    model: FleetModel
    left_out: Mapping[str, str]

    def of_run(self, fitted: Fitted) -> tuple[str, ...]:
        """Parameters of a model that the fleet does not tell."""
        return tuple(symbol for symbol in fitted.values if symbol not in self.model.told)

    def measured(self, fitted: Fitted) -> Throttle:
        """Each unit as a plant of a model, whose own values stand for what the fleet does not tell."""
        return self._plants(fitted, self.model, np.tile(fitted.x, (len(self.model.units), 1)))

    def drawn(self, fitted: Fitted, rest: np.ndarray, seed: int) -> Throttle:
        """Units not made yet as plants of a model.

        Args:
            fitted: the model.
            rest: its coordinates, a row a unit, for what the fleet does not tell, shape (D, P).
            seed: of the random numbers.
        """
        return self._plants(fitted, self.model.future(len(rest), np.random.default_rng(seed)), rest)

    def _plants(self, fitted: Fitted, units: FleetModel, rest: np.ndarray) -> Throttle:
        told = {symbol: units.values[symbol] for symbol in self.model.told if symbol in fitted.values}
        return Throttle.build(fitted.free_parameters.layout.types, fitted.values_at(rest) | told)

    def must_be_of(self, fitted: Fitted) -> None:
        """Refuse a model of something else: its parameters would mean something else too.

        Raises:
            UsageError: other effects, or another gear.
        """
        mine, theirs = body_types(fitted.free_parameters.layout), self.model.types
        alone = [_names(have, lack) for have, lack in ((mine, theirs), (theirs, mine))]
        if any(alone):
            found = " and ".join(f"{who} alone {names}" for who, names in
                                 zip(("the run has", "the fleet has"), alone, strict=True) if names)  # fmt: skip
            raise UsageError(f"{self.where}: {found}. Both must have the same effects, for a parameter means something "
                             "else beside another effect. Name them in [model] effects of fleet.toml or rig.toml, and "
                             "run `etcfit fleet` or `etcfit fit` again.")  # fmt: skip
        gears = self.model.config.gear_ratio, fitted.config.gear_ratio
        if abs(gears[0] - gears[1]) > _ALIKE * abs(gears[1]):
            raise UsageError(f"{self.where}: gear_ratio is {gears[0]:g} in the fleet and {gears[1]:g} in the run. They "
                             "are no parts of one design: give the fleet of this throttle.")  # fmt: skip


def _names(have: tuple[type, ...], lack: tuple[type, ...]) -> str:
    return ", ".join(effect.name for effect in have if effect not in lack)  # type: ignore[attr-defined]


def design_for_parts(
    fitted: Fitted,
    parts: Parts,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    rule: str = BEST,
    drawn: np.ndarray | None = None,
    feed_forward: Asked = False,
    report: Report = quiet,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
    log: Series | None = None,
    rules: Mapping[str, Rule] = RULES,
    present: Mapping[str, float] = NOTHING,
) -> Design:
    """Tune by every rule, and propose gains that hold for the parts of a design.

    As `design.design`, but `optimal` is sought over units drawn from the population in place of draws of the one model
    (`best_for_parts`), and every rule is judged on the parts too.

    Args:
        fitted, ecu, requirements, rule, drawn, feed_forward, settings, profile, log: see `design.design`.
        parts: of the design that the model is one of.
        report: called with what is going on and the share done.
        rules: by name, `rule` among them.
    Raises:
        UsageError: as `design.design`, or parts of another design.
    """
    must_be_known(rule, rules)
    parts.must_be_of(fitted)
    rest = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed)) if drawn is None else drawn
    task = task_of(fitted, ecu, requirements, rest, feed_forward, settings, profile, log, present)
    future = parts.drawn(fitted, rest, settings.seed)
    every = {**rules, BEST: lambda task: best_for_parts(task, future)} if BEST in rules else rules
    found = propose(fitted, task, rule, every, "laplace" if drawn is None else "posterior", report)
    report("judging the parts", 0.97)
    return replace(found, parts=_fare(found, parts, future))


def best_for_parts(task: Task, plants: Throttle) -> Gains | Refusal:
    """The rule `optimal` over drawn units, anew with those that fail until the share `certain` meets everything.

    Args:
        task: its nominal model is among those that decide.
        plants: drawn units, parameters of shape (D,).
    """
    optimum, names = task.settings.optimum, _drawn(task.loop.draws - 1)
    asked = FleetDesignSettings(share=optimum.certain, few=optimum.few)
    return SearchOverUnits(plants, names, asked)(sought_over(task, plants))


def _drawn(count: int) -> tuple[str, ...]:
    return tuple(f"drawn {k + 1}" for k in range(count))


def sought_over(task: Task, plants: Throttle) -> Task:
    """The task with some plants, of shape (D,), behind the nominal one in place of those that it had."""
    return replace(task, loop=replace(task.loop, throttles=united(task.loop.first(1).throttles, plants)))


def _fare(found: Design, parts: Parts, future: Throttle) -> PartsVerdict:
    """The gains of every rule on measured and drawn units, the proposed ones outside the bench too."""
    task, units, ranges = found.task, parts.model.units, found.settings.conditions
    loop = replace(task.loop, throttles=united(parts.measured(found.fitted), future))
    count, at_once = len(units), task.loop.draws
    names = (*units, *_drawn(loop.draws - count))
    have = {name: tuned.gains for name, tuned in found.tuned.items() if tuned.gains is not None}
    columns = Gains(*(np.array(column, dtype=float) for column in zip(*have.values(), strict=True)))
    own, rest = np.arange(count), np.arange(count, loop.draws)
    rules = {name: OnParts(each.taking(own), each.taking(rest)) for name, each in
             zip(have, unit_by_unit(task, loop, names, columns, at_once), strict=True)}  # fmt: skip
    ends = corners(ranges)
    here = scattered(ranges, rest.size, np.random.default_rng(ranges.seed))
    there = Conditions(*(np.concatenate((np.tile(end, count), one)) for end, one in zip(ends, here, strict=True)))
    which = np.concatenate((np.repeat(own, ends.supply.size), rest))
    outside = unit_by_unit(task, under(loop.taking(which), there, ranges), _placed(names, which, there),
                           Gains(*(np.array([g]) for g in found.proposed)), at_once)[0]  # fmt: skip
    at_corners = np.arange(which.size - rest.size)
    return PartsVerdict(parts.where, parts.name, parts.of_run(found.fitted), parts.left_out, rules,
                        outside.taking(at_corners), outside.taking(np.arange(at_corners.size, which.size)))  # fmt: skip


def _placed(names: tuple[str, ...], which: np.ndarray, there: Conditions) -> tuple[str, ...]:
    """Units, each with the conditions that it is under."""
    each = zip(which.tolist(), *(ends.tolist() for ends in there), strict=True)
    return tuple(f"{names[k]} at {supply:.3g} V, {winding:.3g} degrees Celsius, friction {friction:.2g}"
                 for k, supply, winding, friction in each)  # fmt: skip
