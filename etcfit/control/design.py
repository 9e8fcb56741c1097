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
from ..model.feed_forward import Term, TermNames, listed, terms_of
from ..model.throttle import Throttle
from ..rig.ecu import GAINS
from .fleet import EVERY_UNIT, Parts, SearchOverUnits, best_for_parts, fare_on_parts, one_by_one, representatives
from .judged import Robust, Tuned, judged, outside_the_bench
from .linearise import linear_plant
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
from .settings import DesignSettings
from .supply_table import SupplyTable, supply_table

DRAWS, SEED = DesignSettings().draws, DesignSettings().seed
PAPERS = Requirements()  # section 4.1
BEST = "optimal"
NOTHING: Mapping[str, float] = MappingProxyType({})
_OF_BEST = 0.8  # share of the time of all rules that `optimal` takes, approximately


@dataclass(frozen=True, eq=False)
class Design:
    """Gains for a rig."""

    fitted: Fitted  # the model
    task: Task  # the input of the rules
    chosen: Tuned  # the result of the rule whose gains are proposed
    tuned: Mapping[str, Tuned]  # the result of every rule, by name
    draws: int  # number of models on which they were judged, including the nominal one
    origin: str  # "posterior", "laplace" or "fleet": origin of the draws; those of a fleet are its units
    bias: Bias  # the voltage that holds each position, for an ECU that has such a curve
    # voltage for dry friction, back-EMF and drag of a moving plate, for an ECU with such a feed-forward
    sliding: Sliding
    robust: Robust  # the chosen gains under the conditions of a car
    supply_table: SupplyTable  # the chosen gains as a table over the supply, and its benefit
    front: tuple[FrontPoint, ...]  # the least tracking error within each limit of the duty's activity
    safety: Safety  # the behaviour of the chosen gains when a part fails
    limits: tuple[str, ...]  # where the chosen gains miss a requirement, the limits that keep any gains from meeting it
    # the result on each unit, where the models are the units of a fleet; otherwise None
    fleet: FleetVerdict | None = None
    # the result of every rule on the parts of a design, where a fleet is given; otherwise None
    parts: PartsVerdict | None = None
    anyway: bool = False  # gains are given even where the model behind them is no estimate

    @property
    def withheld(self) -> bool:
        """Whether the gains are withheld: the model behind them is no estimate, and `anyway` is not set."""
        return bool(self.fitted.state.cautions) and not self.anyway

    @property
    def setpoint(self) -> Setpoint:
        """The scenarios on which gains were judged."""
        return self.task.setpoint

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of feed-forward with which the gains were found."""
        return self.task.terms

    @property
    def proposed(self) -> Gains:
        """The gains of the chosen rule."""
        assert self.chosen.gains is not None, "the proposed rule has gains"
        return self.chosen.gains

    @property
    def settings(self) -> DesignSettings:
        """The settings of the design."""
        return self.task.settings

    def written(self, gains: Gains, notation: Notation) -> Terms:
        """Gains in the notation of the ECU for which they were sought."""
        body = self.task.loop.body
        return notation.written(gains, self.task.ecu, body.upper - body.lower)


def ecu_of(fitted: Fitted, **given: float) -> Ecu:
    """The ECU for which gains are sought: the given fields, and the rest as in [ecu] of rig.toml, which describes the
    ECU that drove the logs.

    Without [ecu] the rest has defaults, with the supply of rig.toml and a derivative filter of two periods. Its sensor
    has the noise of the rig's.
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
    """The gains of the ECU that [ecu] of rig.toml describes, known or fitted; a refusal where the fit did not determine
    one of them.

    Args:
        unit: one of each gain in SI, for an ECU whose unit is known.
        present: P, I and D of that ECU in its own unit, which take precedence; see `control.own_numbers`.
    """
    if unit is not None and all(name in present for name in Terms._fields):
        return Gains(*(present[name] * one for name, one in zip(Terms._fields, unit, strict=True)))
    if fitted.config.ecu is None:
        return Refusal("rig.toml describes no ECU, see [ecu]")
    if lost := [symbol for symbol in GAINS.values() if fitted.doubt(symbol) > fitted.identifiability.unknown]:
        return Refusal(f"the data do not determine {', '.join(lost)}")
    return Gains(*(fitted.values[symbol] for symbol in GAINS.values()))


def task_of(
    fitted: Fitted,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    drawn: np.ndarray | None = None,
    feed_forward: TermNames = False,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
    log: Series | None = None,
    present: Mapping[str, float] = NOTHING,
) -> Task:
    """The input of the rules.

    Args:
        drawn: coordinates of further models, shape (D, P); None: they are drawn from the Laplace approximation.
        feed_forward: terms ahead of the PID, see `model.feed_forward`: True for the curve of holding voltages alone.
        settings: number of draws, and the budgets of simulation and rules.
        log: setpoint of a log from the car, per cent of the travel; None for none.
        present: gains that the ECU has now, in its own numbers, see `control.own_numbers`.
    Raises:
        UsageError: a term of feed-forward that does not exist, or that the ECU cannot have.
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
    plant, found = linear_plant(fitted), gains_as_found(fitted, unit, checked(present))
    return Task(plant, ecu, requirements, loop, setpoint, found, settings, profile, terms, present)


def _refuse_others(terms: tuple[Term, ...], profile: EcuProfile) -> None:
    """Refuse terms of feed-forward that an ECU cannot have."""
    if Term.SPRING in terms and Term.SPRING not in profile.terms:
        raise UsageError(f"{profile.title} has no table of feed-forward. Leave --feed-forward out.")
    if others := [term for term in terms if term not in profile.terms]:
        able = ", ".join(each.name for each in PROFILES if set(others) <= set(each.terms))
        raise UsageError(f"{profile.title} has no feed-forward of {' and '.join(listed(others))}: it runs no user "
                         f"code. Leave --feed-forward-terms out, or design for an ECU that does: {able}.")  # fmt: skip


def _curve(throttle: Throttle, body: Body, profile: EcuProfile | None) -> Bias:
    """The holding voltages at points that the ECU's table can have."""
    table = None if profile is None else profile.bias
    return bias_of(throttle, *body) if table is None else bias_of(throttle, *body, table.points, table.positions)


def design(
    fitted: Fitted,
    ecu: Ecu,
    requirements: Requirements = PAPERS,
    rule: str = BEST,
    drawn: np.ndarray | None = None,
    feed_forward: TermNames = False,
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
        parts: parts of the design to which the model belongs. `optimal` is then sought over units drawn from their
            population instead of draws of the one model (`best_for_parts`), and every rule is judged on the parts too.
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
    feed_forward: TermNames = False,
    report: Report = quiet,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
    log: Series | None = None,
    rules: Mapping[str, Rule] = RULES,
    present: Mapping[str, float] = NOTHING,
) -> Design:
    """Tune by every rule, and propose gains that meet the requirements on nearly all units of a fleet.

    The nominal model is the mean unit. `optimal` is sought over extreme and random units. Where too few of all units
    meet every requirement with its gains, the search is repeated with failing units included. The result is the first
    gains with which enough units meet every requirement, otherwise the gains with which most units do.

    Args:
        model: the units, by their shrunk values.
        ecu, requirements, feed_forward, settings, profile, log, present: see `task_of`.
        future: units drawn from the population (`future_units`), which are judged separately from those of the fleet.
    Raises:
        UsageError: no such rule, or a rule that has no gains for this plant.
    """
    _must_be_known(rule, rules)
    fitted, everyone = model.nominal, model.coordinates
    seen = everyone
    if future is not None and len(everyone) < settings.draws - 1:  # too few to represent future units
        seen = np.vstack((everyone, future.coordinates))
    known = representatives(seen, settings.draws - 1, EVERY_UNIT)
    optimum = replace(settings.optimum, certain=EVERY_UNIT.share, few=min(EVERY_UNIT.few, len(known) + 1))
    settings = replace(settings, optimum=optimum)
    task = task_of(fitted, ecu, requirements, seen[known], feed_forward, settings, profile, log, present)
    plants = fitted.throttles(everyone)
    search = SearchOverUnits(plants, model.units, EVERY_UNIT)
    found = propose(fitted, task, rule, _with_best(rules, search), "fleet", report)
    report("judging every unit", 0.97)
    own, ahead = one_by_one(task, plants, model.units, found.proposed), None
    if future is not None:
        fresh = future.taking(np.setdiff1d(np.arange(len(future.units)), known - len(everyone)))
        ahead = one_by_one(task, fitted.throttles(fresh.coordinates), fresh.units, found.proposed).share
    return replace(found, fleet=FleetVerdict(EVERY_UNIT, own, ahead, max(1, search.made)))


def _with_best(rules: Mapping[str, Rule], search: Rule) -> Mapping[str, Rule]:
    """The rules with another search in place of `optimal`, if they include it."""
    return {**rules, BEST: search} if BEST in rules else rules


def _must_be_known(rule: str, rules: Mapping[str, Rule]) -> None:
    if rule not in rules:
        raise UsageError(f"no tuning rule is called {rule!r}. Known: {', '.join(rules)}.")


def propose(
    fitted: Fitted, task: Task, rule: str, rules: Mapping[str, Rule], origin: str, report: Report = quiet
) -> Design:
    """Tune a task by some rules, and propose the gains of one of them.

    Args:
        origin: origin of the draws, see `Design`.
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
        report("finding the limits that bind", 0.85)
        limits = binding(task)
    report("tracking against effort", 0.9)
    assert chosen.gains is not None, "a rule that refused is not proposed"
    robust, points = outside_the_bench(task, chosen.gains), front(task, chosen.gains)
    table = supply_table(task, chosen.gains)
    report("simulating failures", 0.95)
    safe = safety_of(task, chosen.gains)
    bias = task.loop.bias or _curve(fitted.throttle, task.loop.body, task.profile)
    sliding = sliding_of(fitted.throttle, *task.loop.body, task.settings.sliding)
    return Design(fitted, task, chosen, tuned, task.loop.draws, origin, bias, sliding, robust, table, points, safe,
                  limits)  # fmt: skip


_EASED_SUPPLY = 4.0  # factor on the supply voltage in the test whether the supply binds
_EASED_PERIOD = 5e-4  # s: period of the ECU in the test whether its clock binds
_EASED_MARGIN = 1e-3  # dB and degrees: required margins in the test whether they bind
_EASED: dict[str, Callable[[Task], Task]] = {
    "the supply voltage": lambda task: _with_ecu(task, supply=_EASED_SUPPLY * task.ecu.supply),
    "the ECU's period and delay": lambda task: _with_ecu(task, period=min(task.ecu.period, _EASED_PERIOD), delay=0.0),
    "the required stability margins": lambda task: replace(
        task, requirements=replace(task.requirements, gain_margin_db=_EASED_MARGIN, phase_margin_deg=_EASED_MARGIN)
    ),
    "dry friction": lambda task: replace(task, loop=_sliding_freely(task.loop)),
    "the resolution of the position sensor": lambda task: _with_ecu(task, resolution=0.0),
    "the noise of the position sensor": lambda task: _with_ecu(task, noise=0.0),
    "the filter ahead of the ECU": lambda task: _with_ecu(task, lag=0.0),
}


def binding(task: Task) -> tuple[str, ...]:
    """The limits each of which, relaxed alone, lets the rule `optimal` meet every requirement on the nominal model."""
    eased = (name for name, ease in _EASED.items() if _meets(ease(task)))
    return tuple(eased) or ("no limit alone: several bind together, or the setpoint itself is too fast",)


def _meets(task: Task) -> bool:
    optimum = task.settings.optimum  # a short search is enough: any gains that meet everything will do
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
    """The loop without dry friction and without its feed-forward."""
    sliding = None if loop.sliding is None else loop.sliding.frictionless()
    return replace(loop, throttles=frictionless(loop.throttles), sliding=sliding)


def frictionless(throttle: Any) -> Any:
    """The models with every dry friction at its off value."""
    return scaled(throttle, dict.fromkeys(DRY_FRICTION, 0.0))
