"""Gains for a fleet: one set that meets the requirements on nearly all of its units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..car_log.log import Series
from ..estimation.fitted_model import FleetModel
from ..estimation.joint_fit import Report, quiet
from ..model.ecu import Ecu
from ..model.ecus import EcuProfile
from ..model.feed_forward import Asked
from ..model.throttle import Throttle
from .design import BEST, NOTHING, PAPERS, Design, must_be_known, propose, task_of
from .fleet_verdict import OneByOne, verdict
from .judged import unit_by_unit
from .pid import RULES, Gains, Refusal, Requirements, Rule, Task
from .pid.optimal import best_over_draws, optimal
from .settings import DesignSettings, FleetDesignSettings

ORIGIN = "fleet"
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
        return one_by_one(task, self.plants, self.units, gains, self.asked.at_once)

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
    own = one_by_one(task, plants, model.units, gains, asked.at_once)
    ahead = None
    if future is not None:
        fresh = future.taking(np.setdiff1d(np.arange(len(future.units)), known - len(everyone)))
        ahead = one_by_one(task, fitted.throttles(fresh.coordinates), fresh.units, gains, asked.at_once)
    return replace(found, fleet=verdict(own, ahead, asked, max(1, search.made)))


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
    if model.law.units < asked.fewest:
        return None
    return model.future(asked.future, np.random.default_rng(asked.seed + 1))
