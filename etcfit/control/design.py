"""From a fitted model to gains: every rule tried on the linear plant and on the nonlinear one, over many draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import UsageError
from ..estimation.fitted_model import Fitted
from ..estimation.joint_fit import Report, quiet
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import EcuProfile
from ..model.throttle import Throttle
from ..rig.ecu import GAINS
from .linearise import reduce, stops
from .pid import RULES, Gains, Metrics, Refusal, Requirements, Rule, Task, linear_loop
from .pid.feedforward import Bias, bias_of
from .pid.loop import Body, Loop
from .pid.margins import margins
from .pid.requirements import REQUIRED
from .pid.response import Judged, judge
from .pid.setpoint import Setpoint, trapezoid
from .settings import DesignSettings

DRAWS, SEED = DesignSettings().draws, DesignSettings().seed
PAPERS = Requirements()  # section 4.1
BEST = "optimal"


@dataclass(frozen=True, eq=False)
class Tuned:
    """What one rule came to.

    Args:
        rule: its name.
        gains: SI, or None where the rule refused.
        why: of a refusal.
        linear, nonlinear: figures of the nominal model.
        met: by requirement, on the nominal nonlinear model.
        met_linear: by requirement, on the linear plant.
        probability_met: share of the draws whose nonlinear response meets every requirement, by a stable loop.
        probability_stable: share of them whose gain and phase margins are what was asked for.
        band: position of the draws at each tick, quantiles 2.5, 50 and 97.5 %, shares of the travel, shape (3, K).
        linear_path: the linear plant's position, shape (K,).
    """

    rule: str
    gains: Gains | None
    why: str
    linear: Metrics | None
    nonlinear: Metrics | None
    met: Mapping[str, bool]
    met_linear: Mapping[str, bool]
    probability_met: float | None
    probability_stable: float | None
    band: np.ndarray | None
    linear_path: np.ndarray | None

    @property
    def stable(self) -> bool:
        """Whether the nominal linear loop is; friction and clamps may hide for one response that it is not."""
        return self.linear is not None and bool(self.linear.gain_margin_db > 0.0)

    @property
    def meets_all(self) -> bool:
        """Every requirement, on the nominal nonlinear model, by a loop that is stable."""
        return self.stable and all(self.met.values())


@dataclass(frozen=True, eq=False)
class Design:
    """Gains for a rig.

    Args:
        fitted: the model.
        task: what the rules were given.
        setpoint: on which they were judged.
        chosen: the rule whose gains are proposed.
        tuned: every rule, by name.
        draws: how many models judged them, the nominal one among them.
        origin: "posterior" or "laplace": where the draws came from.
        bias: the voltage that holds each position, for an ECU that has such a curve.
        limits: where the chosen gains miss a requirement, what keeps any gains from meeting it.
    """

    fitted: Fitted
    task: Task
    setpoint: Setpoint
    chosen: Tuned
    tuned: Mapping[str, Tuned]
    draws: int
    origin: str
    bias: Bias
    limits: tuple[str, ...]

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

    Without [ecu] the rest is by default, the supply rig.toml's and the derivative's filter two periods.
    """
    described = fitted.config.ecu
    if described is None:
        period = given.get("period", Ecu().period)
        described = Ecu(period, fitted.config.supply_V or Ecu().supply, filter=2.0 * period)
    return described._replace(**given)


def gains_as_found(fitted: Fitted) -> Gains | Refusal:
    """Those of the ECU that [ecu] of rig.toml describes, known or fitted; one that the fit called not known is none."""
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
    feed_forward: bool = False,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
) -> Task:
    """What the rules are given.

    Args:
        fitted: the model.
        ecu: the controller.
        requirements: what is asked for.
        drawn: coordinates of further models, shape (D, P); from the Laplace approximation where there are none.
        feed_forward: with the curve of holding voltages ahead of the PID.
        settings: how many draws, and the budgets of simulation and rules.
        profile: the make of ECU that the controller is; None where none is named.
    Raises:
        UsageError: feed-forward for an ECU that has no table of it.
    """
    if feed_forward and profile is not None and profile.bias is None:
        raise UsageError(f"{profile.title} has no table of feed-forward. Leave --feed-forward out.")
    if drawn is None:
        drawn = fitted.laplace(settings.draws - 1, np.random.default_rng(settings.seed))
    body = Body(fitted.config.gear_ratio, *stops(fitted))
    throttles = fitted.throttles(np.vstack((fitted.x, drawn)))
    bias = _curve(fitted.throttle, body, profile) if feed_forward else None
    loop = Loop(throttles, body, ecu, bias, settings.loop)
    return Task(reduce(fitted).plant, ecu, requirements, loop, gains_as_found(fitted), settings, profile)


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
    feed_forward: bool = False,
    report: Report = quiet,
    settings: DesignSettings = DesignSettings(),
    profile: EcuProfile | None = None,
) -> Design:
    """Tune by every rule, and propose the gains of one.

    Args:
        fitted, ecu, requirements, drawn, feed_forward, settings, profile: see `task_of`.
        rule: whose gains are proposed.
        report: called with what is going on and the share done.
    Raises:
        UsageError: no such rule, a model without an electrical side, or a rule that has no gains for this plant.
    """
    if rule not in RULES:
        raise UsageError(f"no tuning rule is called {rule!r}. Known: {', '.join(RULES)}.")
    task = task_of(fitted, ecu, requirements, drawn, feed_forward, settings, profile)
    return propose(fitted, task, rule, RULES, "laplace" if drawn is None else "posterior", report)


def propose(
    fitted: Fitted, task: Task, rule: str, rules: Mapping[str, Rule], origin: str, report: Report = quiet
) -> Design:
    """Tune a task by some rules, and propose the gains of one of them.

    Args:
        fitted: the model.
        task: what the rules are given.
        rule: whose gains are proposed.
        rules: by name, `rule` among them.
        origin: where the draws came from, "posterior" or "laplace".
        report: called with what is going on and the share done.
    Raises:
        UsageError: the rule has no gains for this plant.
    """
    found: dict[str, Gains | Refusal] = {}
    for k, (name, tune) in enumerate(rules.items()):
        report(f"tuning: {name.replace('_', ' ')}", 0.05 + 0.7 * k / len(rules))
        found[name] = tune(task)
    refused = found[rule]
    if isinstance(refused, Refusal):
        raise UsageError(f"{rule} has no gains for this plant: {refused.why}. Choose another rule.")
    report("judging every rule over the draws", 0.8)
    setpoint = trapezoid()
    tuned = judged(task, found, setpoint)
    chosen = tuned[rule]
    limits: tuple[str, ...] = ()
    if not chosen.meets_all:
        report("looking for what binds", 0.85)
        limits = binding(task, setpoint)
    bias = task.loop.bias or _curve(fitted.throttle, task.loop.body, task.profile)
    return Design(fitted, task, setpoint, chosen, tuned, task.loop.draws, origin, bias, limits)


def judged(task: Task, found: Mapping[str, Gains | Refusal], setpoint: Setpoint) -> dict[str, Tuned]:
    """Figures of every rule's gains, on the linear plant and over the draws of the nonlinear one."""
    have = {name: gains for name, gains in found.items() if isinstance(gains, Gains)}
    gains = Gains(*(np.array(column, dtype=float) for column in zip(*have.values(), strict=True)))
    path = np.asarray(task.loop.respond(gains, setpoint).position)
    share = np.asarray(task.loop.share(path))
    figures = judge(setpoint, setpoint.instants(task.ecu.period), share)
    safe = margins(Gains(*(g[None] for g in gains)), task.loop.linear(), task.ecu)
    out = {}
    for name, refusal in found.items():
        if isinstance(refusal, Refusal):
            out[name] = Tuned(name, None, refusal.why, None, None, {}, {}, None, None, None, None)
            continue
        k = list(have).index(name)
        column = Judged(*(np.asarray(figure)[:, k] for figure in figures))
        over_draws = _OverDraws(column, share[:, k], safe.gain_db[:, k], safe.phase_deg[:, k])
        out[name] = _tuned(task, name, refusal, setpoint, over_draws)
    return out


class _OverDraws(NamedTuple):
    """How one rule's gains fare over the draws.

    Args:
        figures: of the responses, shape (D,) each.
        share: position at each tick, share of the travel, shape (D, K).
        gain_margin, phase_margin: of the linear loops, dB and degrees, shape (D,).
    """

    figures: Judged
    share: np.ndarray
    gain_margin: np.ndarray
    phase_margin: np.ndarray


def _tuned(task: Task, name: str, gains: Gains, setpoint: Setpoint, over_draws: _OverDraws) -> Tuned:
    """What one rule came to."""
    column, share, gain_margin, phase_margin = over_draws
    asked, time = task.requirements, setpoint.instants(task.ecu.period)
    margin = [float(m) for m in margins(gains, task.plant, task.ecu)]
    straight = linear_loop.respond(task.plant, gains, task.ecu, setpoint)
    linear = Metrics(*(float(v) for v in judge(setpoint, time, straight)), *margin)
    nonlinear = Metrics(*(float(v[0]) for v in column), *margin)
    every = np.all([_below(column, asked, symbol) for symbol in REQUIRED], axis=0) & (gain_margin > 0.0)
    stable = (gain_margin >= asked.gain_margin_db) & (phase_margin >= asked.phase_margin_deg)
    return Tuned(
        rule=name,
        gains=Gains(*(float(g) for g in gains)),
        why="",
        linear=linear,
        nonlinear=nonlinear,
        met={s: bool(_below(nonlinear, asked, s)) for s in REQUIRED},
        met_linear={s: bool(_below(linear, asked, s)) for s in REQUIRED},
        probability_met=float(np.mean(every)),
        probability_stable=float(np.mean(stable)),
        band=np.quantile(share, (0.025, 0.5, 0.975), axis=0),
        linear_path=straight,
    )


def _below(figures: Any, asked: Requirements, symbol: str) -> Any:
    return getattr(figures, symbol) < getattr(asked, symbol)


_EASED: dict[str, Callable[[Task], Task]] = {
    "the supply voltage": lambda task: _with_ecu(task, supply=task.settings.eased_supply * task.ecu.supply),
    "the ECU's period and delay": lambda task: _with_ecu(
        task, period=min(task.ecu.period, task.settings.eased_period), delay=0.0
    ),
    "the stability margins asked for": lambda task: replace(
        task,
        requirements=replace(
            task.requirements,
            gain_margin_db=task.settings.eased_margin,
            phase_margin_deg=task.settings.eased_margin,
        ),
    ),
    "dry friction": lambda task: replace(task, loop=replace(task.loop, throttles=frictionless(task.loop.throttles))),
    "the resolution of the position sensor": lambda task: _with_ecu(task, resolution=0.0),
}


def binding(task: Task, setpoint: Setpoint) -> tuple[str, ...]:
    """What, eased alone, would let our optimum meet every requirement on the nominal model."""
    eased = (name for name, ease in _EASED.items() if _meets(ease(task), setpoint))
    return tuple(eased) or ("no limit alone: several bind together, or the setpoint itself is too fast",)


def _meets(task: Task, setpoint: Setpoint) -> bool:
    gains = RULES[BEST](task)
    if isinstance(gains, Refusal):
        return False
    figures = task.loop.first(1).judged(Gains(*(np.array([g]) for g in gains)), setpoint)
    return all(bool(np.all(_below(figures, task.requirements, symbol))) for symbol in REQUIRED)


def _with_ecu(task: Task, **changes: float) -> Task:
    ecu = task.ecu._replace(**changes)
    return replace(task, ecu=ecu, loop=task.loop.under(ecu))


_FRICTION = ("T_f", "T_s", "T_m", "mu_g", "T_z")


def frictionless(throttle: Any) -> Any:
    """The models with every dry friction at its off value."""

    def smooth(effect: Any) -> Any:
        gone = {name: 0.0 * getattr(effect, name) for name in _FRICTION if hasattr(effect, name)}
        return replace(effect, **gone) if gone else effect

    return replace(throttle, effects=tuple(smooth(effect) for effect in throttle.effects))
