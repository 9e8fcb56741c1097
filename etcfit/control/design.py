"""From a fitted model to gains: every rule tried on the linear plant and on the nonlinear one, over many draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from ..car_log.log import Series
from ..errors import UsageError
from ..estimation.fitted_model import Fitted, FleetModel
from ..estimation.joint_fit import Report, quiet
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import PROFILES, EcuProfile
from ..model.feed_forward import Asked, Term, listed, terms_of
from ..model.throttle import Throttle
from ..rig.ecu import GAINS
from .fleet import EVERY_UNIT, Parts, SearchOverUnits, best_for_parts, fare_on_parts, one_by_one, representatives
from .judged import Robust, Tuned, judged, outside_the_bench
from .linearise import reduce
from .on_units import FleetVerdict, PartsVerdict
from .own_numbers import checked
from .pid import RULES, Gains, Refusal, Requirements, Rule, Task
from .pid.conditions import DRY_FRICTION, course, of_log, scaled
from .pid.feedforward import Bias, Sliding, bias_of, sliding_of
from .pid.loop import Body, Loop
from .pid.optimal import FrontPoint, front
from .safety import Safety
from .safety import safety as safety_of
from .setpoint import Setpoint
from .settings import DesignSettings, FleetDesignSettings
from .supply_table import SupplyTable, supply_table

DRAWS, SEED = DesignSettings().draws, DesignSettings().seed
PAPERS = Requirements()  # section 4.1
BEST = "optimal"
NOTHING: Mapping[str, float] = MappingProxyType({})
_OF_BEST = 0.8  # of the time that all rules take, about


@dataclass(frozen=True, eq=False)
class Design:
    """Gains for a rig.

    Args:
        fitted: the model.
        task: what the rules were given.
        chosen: the rule whose gains are proposed.
        tuned: every rule, by name.
        draws: how many models judged them, the nominal one among them.
        origin: "posterior", "laplace" or "fleet": where the draws came from; the last are units.
        bias: the voltage that holds each position, for an ECU that has such a curve.
        sliding: what dry friction, back-EMF and drag take of a moving plate, for an ECU that can put it ahead.
        robust: the chosen gains under the conditions of a car.
        supply_table: they as a table over the supply, and what it is worth there.
        front: the least tracking error within each limit of the duty's activity.
        safety: what the chosen gains do where something fails.
        limits: where the chosen gains miss a requirement, what keeps any gains from meeting it.
        fleet: how they fare unit by unit, where the models are the units of a fleet; else None.
        parts: how every rule fares on the parts of a design, where a fleet tells them; else None.
        anyway: gains are to be given even where the model behind them is no estimate.
    """

    fitted: Fitted
    task: Task
    chosen: Tuned
    tuned: Mapping[str, Tuned]
    draws: int
    origin: str
    bias: Bias
    sliding: Sliding
    robust: Robust
    supply_table: SupplyTable
    front: tuple[FrontPoint, ...]
    safety: Safety
    limits: tuple[str, ...]
    fleet: FleetVerdict | None = None
    parts: PartsVerdict | None = None
    anyway: bool = False

    @property
    def withheld(self) -> bool:
        """Nothing may be typed into an ECU: the model behind the gains is no estimate, and `anyway` is not set."""
        return bool(self.fitted.state.cautions) and not self.anyway

    @property
    def setpoint(self) -> Setpoint:
        """Scenarios on which gains were judged."""
        return self.task.setpoint

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of feed-forward with which the gains were found."""
        return self.task.terms

    @property
    def proposed(self) -> Gains:
        """The gains of the chosen rule."""
        assert self.chosen.gains is not None, "the proposed rule has gains"
        return self.chosen.gains

    @property
    def settings(self) -> DesignSettings:
        """What it was decided by."""
        return self.task.settings

    def written(self, gains: Gains, notation: Notation) -> Terms:
        """Gains as the ECU that they were sought for would write them."""
        body = self.task.loop.body
        return notation.written(gains, self.task.ecu, body.upper - body.lower)


def ecu_of(fitted: Fitted, **given: float) -> Ecu:
    """The ECU that gains are sought for: as given, the rest as [ecu] of rig.toml describes the one that drove the logs.

    Without [ecu] the rest is by default, the supply rig.toml's and the derivative's filter two periods. Its sensor has
    the noise that the rig's has.
    """
    given = {"noise": fitted.position_noise} | given
    described = fitted.config.ecu
    if described is None:
        period = given.get("period", Ecu().period)
        described = Ecu(period, fitted.config.supply_V or Ecu().supply, filter=2.0 * period)
    return described._replace(**given)


def gains_as_found(
    fitted: Fitted, unit: Terms | None = None, present: Mapping[str, float] = NOTHING
) -> Gains | Refusal:
    """Those of the ECU that [ecu] of rig.toml describes, known or fitted; one that the fit called not known is none.

    Args:
        unit: one of each gain in SI, of an ECU whose unit is known.
        present: P, I and D of that ECU in its own unit, which then count; see `control.own_numbers`.
    """
    if unit is not None and all(name in present for name in Terms._fields):
        return Gains(*(present[name] * one for name, one in zip(Terms._fields, unit, strict=True)))
    if fitted.config.ecu is None:
        return Refusal("rig.toml describes no ECU, see [ecu]")
    if lost := [symbol for symbol in GAINS.values() if fitted.doubt(symbol) > fitted.identifiability.unknown]:
        return Refusal(f"the data do not tell {', '.join(lost)}")
    return Gains(*(fitted.values[symbol] for symbol in GAINS.values()))


def task_of(
    fitted: Fitted,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    drawn: np.ndarray | None = None,
    feed_forward: Asked = False,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
    log: Series | None = None,
    present: Mapping[str, float] = NOTHING,
) -> Task:
    """What the rules are given.

    Args:
        drawn: coordinates of further models, shape (D, P); from the Laplace approximation where there are none.
        feed_forward: terms ahead of the PID, see `model.feed_forward`: True for the curve of holding voltages alone.
        settings: how many draws, and the budgets of simulation and rules.
        log: setpoint of a log from the car, per cent of the travel; None for none.
        present: gains that the ECU has now, in its own numbers, see `control.own_numbers`.
    Raises:
        UsageError: a term of feed-forward that there is not, or that the ECU cannot have.
    """
    terms = terms_of(feed_forward)
    if profile is not None:
        _refuse_others(terms, profile)
    if drawn is None:
        drawn = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed))
    body = Body(fitted.config.gear_ratio, *fitted.config.stops)
    throttles = fitted.throttles(np.vstack((fitted.x, drawn)))
    bias = _curve(fitted.throttle, body, profile) if Term.SPRING in terms else None
    sliding = sliding_of(fitted.throttle, *body, settings.sliding).only(terms)
    loop = Loop(throttles, body, ecu, bias, settings.loop, sliding=sliding)
    further = () if log is None else (of_log(log, settings.scenarios),)
    setpoint = course(loop.first(1), settings.scenarios, *further)
    notation, travel = None if profile is None else profile.notation, body.upper - body.lower
    unit = None if notation is None else notation.units(ecu, travel)
    plant, found = reduce(fitted).plant, gains_as_found(fitted, unit, checked(present))
    return Task(plant, ecu, requirements, loop, setpoint, found, settings, profile, terms, present)


def _refuse_others(terms: tuple[Term, ...], profile: EcuProfile) -> None:
    """Refuse terms of feed-forward that an ECU cannot have."""
    if Term.SPRING in terms and Term.SPRING not in profile.terms:
        raise UsageError(f"{profile.title} has no table of feed-forward. Leave --feed-forward out.")
    if others := [term for term in terms if term not in profile.terms]:
        able = ", ".join(each.name for each in PROFILES if set(others) <= set(each.terms))
        raise UsageError(f"{profile.title} cannot put {' and '.join(listed(others))} ahead: it takes no code of yours. "
                         f"Leave --feed-forward-terms out, or design for one that does: {able}.")  # fmt: skip


def _curve(throttle: Throttle, body: Body, profile: EcuProfile | None) -> Bias:
    """The holding voltages as the ECU's own table can name them."""
    table = None if profile is None else profile.bias
    return bias_of(throttle, *body) if table is None else bias_of(throttle, *body, table.points, table.positions)


def design(
    fitted: Fitted,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    rule: str = BEST,
    drawn: np.ndarray | None = None,
    feed_forward: Asked = False,
    report: Report = quiet,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
    log: Series | None = None,
    present: Mapping[str, float] = NOTHING,
    rules: Mapping[str, Rule] = RULES,
    parts: Parts | None = None,
) -> Design:
    """Tune by every rule, and propose the gains of one.

    Args:
        fitted, ecu, requirements, drawn, feed_forward, settings, profile, log, present: see `task_of`.
        parts: of the design that the model is one of. `optimal` is then sought over units drawn from their population
            in place of draws of the one model (`best_for_parts`), and every rule is judged on the parts too.
    Raises:
        UsageError: no such rule, a model without an electrical side, a rule that has no gains for this plant, or parts
            of another design.
    """
    _must_be_known(rule, rules)
    origin = "laplace" if drawn is None else "posterior"
    if drawn is None:
        drawn = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed))
    if parts is not None:
        parts.must_be_of(fitted)
    task = task_of(fitted, ecu, requirements, drawn, feed_forward, settings, profile, log, present)
    if parts is None:
        return propose(fitted, task, rule, rules, origin, report)
    future = parts.drawn(fitted, drawn, settings.seed)
    found = propose(fitted, task, rule, _with_best(rules, lambda task: best_for_parts(task, future)), origin, report)
    report("judging the parts", 0.97)
    return replace(found, parts=fare_on_parts(task, fitted, found.tuned, found.proposed, parts, future))


def design_for_fleet(
    model: FleetModel,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    rule: str = BEST,
    future: FleetModel | None = None,
    feed_forward: Asked = False,
    report: Report = quiet,
    settings: DesignSettings = DesignSettings(),
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
        ecu, requirements, feed_forward, settings, profile, log, present: see `task_of`.
        future: units drawn from the population (`future_units`), which are judged apart from the fleet's own.
    Raises:
        UsageError: no such rule, or a rule that has no gains for this plant.
    """
    _must_be_known(rule, rules)
    fitted, everyone = model.nominal, model.coordinates
    seen = everyone
    if future is not None and len(everyone) < settings.draws - 1:  # too few to stand for those that will come
        seen = np.vstack((everyone, future.coordinates))
    known = representatives(seen, settings.draws - 1, asked)
    optimum = replace(settings.optimum, certain=asked.share, few=min(asked.few, len(known) + 1))
    settings = replace(settings, optimum=optimum)
    task = task_of(fitted, ecu, requirements, seen[known], feed_forward, settings, profile, log, present)
    plants = fitted.throttles(everyone)
    search = SearchOverUnits(plants, model.units, asked)
    found = propose(fitted, task, rule, _with_best(rules, search), "fleet", report)
    report("judging every unit", 0.97)
    own, ahead = one_by_one(task, plants, model.units, found.proposed), None
    if future is not None:
        fresh = future.taking(np.setdiff1d(np.arange(len(future.units)), known - len(everyone)))
        ahead = one_by_one(task, fitted.throttles(fresh.coordinates), fresh.units, found.proposed).share
    return replace(found, fleet=FleetVerdict(asked, own, ahead, max(1, search.made)))


def _with_best(rules: Mapping[str, Rule], search: Rule) -> Mapping[str, Rule]:
    """The rules with another search in place of `optimal`, where it is among them."""
    return {**rules, BEST: search} if BEST in rules else rules


def _must_be_known(rule: str, rules: Mapping[str, Rule]) -> None:
    if rule not in rules:
        raise UsageError(f"no tuning rule is called {rule!r}. Known: {', '.join(rules)}.")


def propose(
    fitted: Fitted, task: Task, rule: str, rules: Mapping[str, Rule], origin: str, report: Report = quiet
) -> Design:
    """Tune a task by some rules, and propose the gains of one of them.

    Args:
        origin: where the draws came from, see `Design`.
    Raises:
        UsageError: the rule has no gains for this plant.
    """
    found: dict[str, Gains | Refusal] = {}
    for k, (name, tune) in enumerate(rules.items()):
        share = (_OF_BEST if BEST in found else 0.0) + (1.0 - _OF_BEST) * k / len(rules)
        report(f"tuning: {name.replace('_', ' ')}", 0.05 + 0.75 * share)
        found[name] = tune(task)
    refused = found[rule]
    if isinstance(refused, Refusal):
        raise UsageError(f"{rule} has no gains for this plant: {refused.why}. Choose another rule.")
    report("judging every rule over the draws", 0.8)
    tuned = judged(task, found)
    chosen = tuned[rule]
    limits: tuple[str, ...] = ()
    if not chosen.meets_all:
        report("looking for what binds", 0.85)
        limits = binding(task)
    report("tracking against effort", 0.9)
    assert chosen.gains is not None, "a rule that refused is not proposed"
    robust, points = outside_the_bench(task, chosen.gains), front(task, chosen.gains)
    table = supply_table(task, chosen.gains)
    report("where something fails", 0.95)
    safe = safety_of(task, chosen.gains)
    bias = task.loop.bias or _curve(fitted.throttle, task.loop.body, task.profile)
    sliding = sliding_of(fitted.throttle, *task.loop.body, task.settings.sliding)
    return Design(fitted, task, chosen, tuned, task.loop.draws, origin, bias, sliding, robust, table, points, safe,
                  limits)  # fmt: skip


_EASED_SUPPLY = 4.0  # factor on the supply voltage when it is tried whether the supply is what binds
_EASED_PERIOD = 5e-4  # s, of the ECU when it is tried whether its clock is
_EASED_MARGIN = 1e-3  # dB and degrees, the margins required when it is tried whether they are
_EASED: dict[str, Callable[[Task], Task]] = {
    "the supply voltage": lambda task: _with_ecu(task, supply=_EASED_SUPPLY * task.ecu.supply),
    "the ECU's period and delay": lambda task: _with_ecu(task, period=min(task.ecu.period, _EASED_PERIOD), delay=0.0),
    "the stability margins asked for": lambda task: replace(
        task,
        requirements=replace(
            task.requirements,
            gain_margin_db=_EASED_MARGIN,
            phase_margin_deg=_EASED_MARGIN,
        ),
    ),
    "dry friction": lambda task: replace(task, loop=_sliding_freely(task.loop)),
    "the resolution of the position sensor": lambda task: _with_ecu(task, resolution=0.0),
    "the noise of the position sensor": lambda task: _with_ecu(task, noise=0.0),
    "the filter ahead of the ECU": lambda task: _with_ecu(task, lag=0.0),
}


def binding(task: Task) -> tuple[str, ...]:
    """What, eased alone, would let our optimum meet every requirement on the nominal model."""
    eased = (name for name, ease in _EASED.items() if _meets(ease(task)))
    return tuple(eased) or ("no limit alone: several bind together, or the setpoint itself is too fast",)


def _meets(task: Task) -> bool:
    optimum = task.settings.optimum  # whether anything does is asked, not what does best
    settings = replace(task.settings, optimum=replace(optimum, searches=1, starts=1, spares=optimum.spares[:1]))
    gains = RULES[BEST](replace(task, loop=task.loop.first(1), settings=settings))
    if isinstance(gains, Refusal):
        return False
    figures = task.loop.first(1).figures(Gains.stacked(gains), task.setpoint)
    return all(bool(np.all(met)) for met in task.requirements.met(figures).values())


def _with_ecu(task: Task, **changes: float) -> Task:
    ecu = task.ecu._replace(**changes)
    return replace(task, ecu=ecu, loop=task.loop.under(ecu))


def _sliding_freely(loop: Loop) -> Loop:
    """Without dry friction, and without what is put ahead for it."""
    sliding = None if loop.sliding is None else loop.sliding.frictionless()
    return replace(loop, throttles=frictionless(loop.throttles), sliding=sliding)


def frictionless(throttle: Any) -> Any:
    """The models with every dry friction at its off value."""
    return scaled(throttle, dict.fromkeys(DRY_FRICTION, 0.0))
