"""Evaluates the gains of each rule: on the linear plant, on the nonlinear one, and under the conditions of a car."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .loop_figures import FIGURES, OF_THE_PAPER, judge, judge_each
from .on_units import OneByOne
from .pid import Gains, LoopFigures, Refusal, Task
from .pid.conditions import Conditions, at_corners, corners, scattered, under
from .pid.linear_loop import margins, respond
from .pid.loop import Loop
from .setpoint import trapezoid

PAPERS_SETPOINT = trapezoid()


@dataclass(frozen=True, eq=False)
class Robust:
    """Results of gains where supply, winding and friction differ from those of the bench."""

    worst: LoopFigures  # figures of the nominal model, each at its worst over the corners of the conditions
    corner: Conditions  # the corner at which a requirement is missed by most, or met most narrowly
    met: Mapping[str, bool]  # by requirement, at every corner
    stable: bool  # the linear loop is, at every corner
    probability_met: float  # share of the draws, each under conditions drawn for it, that meet every requirement

    @property
    def meets_all(self) -> bool:
        """Whether stable loops meet every requirement at every corner."""
        return self.stable and all(self.met.values())


@dataclass(frozen=True, eq=False)
class Tuned:
    """The result of one rule."""

    rule: str  # its name
    gains: Gains | None  # SI, or None where the rule refused
    why: str  # reason of a refusal
    linear: LoopFigures | None = None  # figures of the linear plant on the paper's trapezoid
    nonlinear: LoopFigures | None = None  # figures of the nominal model, the worst of all scenarios
    scenarios: Mapping[str, LoopFigures] = field(default_factory=dict)  # figures of the nominal model, by scenario
    # by requirement, whether the nominal nonlinear model meets it in every scenario
    met: Mapping[str, bool] = field(default_factory=dict)
    # by requirement of the paper, whether the linear plant meets it
    met_linear: Mapping[str, bool] = field(default_factory=dict)
    # share of the draws whose nonlinear response meets every requirement with a stable loop, under a noise sequence
    # that no search used, because the noise decides whether a sticking plate slips
    probability_met: float | None = None
    probability_stable: float | None = None  # share of them whose gain and phase margins meet the requirements
    # position of the draws at each tick, quantiles 2.5, 50 and 97.5 %, shares of the travel, shape (3, K)
    band: np.ndarray | None = None

    @property
    def stable(self) -> bool:
        """Whether the nominal linear loop is stable; in one response friction and clamps may hide that it is not."""
        return self.linear is not None and bool(self.linear.gain_margin_db > 0.0)

    @property
    def meets_all(self) -> bool:
        """Whether the nominal nonlinear model meets every requirement with a stable loop."""
        return self.stable and all(self.met.values())


def judged(task: Task, found: Mapping[str, Gains | Refusal]) -> dict[str, Tuned]:
    """Figures of every rule's gains, on the linear plant and over the draws of the nonlinear one."""
    have = {name: gains for name, gains in found.items() if isinstance(gains, Gains)}
    gains = Gains.stacked(*have.values())
    share, figures = task.loop.tried(gains, task.setpoint)
    at_bench, out = with_margins(task, task.loop, gains, figures), {}
    anew = at_bench
    if task.ecu.noise > 0.0:
        anew = over_models(task, task.loop.with_new_noise_seed(), gains)
    for name, refusal in found.items():
        if isinstance(refusal, Refusal):
            out[name] = Tuned(name, None, refusal.why)
        else:
            k = list(have).index(name)
            out[name] = _tuned(task, name, refusal, share[:, k], at_bench.of_gains(k), anew.of_gains(k))
    return out


def outside_the_bench(task: Task, gains: Gains) -> Robust:
    """Results of gains at the corners of the conditions, and over joint draws of models and conditions."""
    requirements, ranges = task.requirements, task.settings.conditions
    conditions = scattered(ranges, task.loop.draws, np.random.default_rng(ranges.seed))
    loops = at_corners(task.loop, ranges), under(task.loop, conditions, ranges)
    one = Gains.stacked(gains)
    there, anywhere = (over_models(task, loop, one).of_gains(0) for loop in loops)
    worst = there.worst()
    met = {symbol: bool(met) for symbol, met in requirements.met(worst).items()}
    k = int(np.argmax(np.max(list(requirements.strain(there).values()), axis=0)))
    corner = Conditions(*(float(ends[k]) for ends in corners(ranges)))
    return Robust(worst, corner, met, worst.gain_margin_db > 0.0, float(np.mean(requirements.all_met(anywhere))))


def over_models(task: Task, loop: Loop, gains: Gains) -> LoopFigures:
    """Figures of gains of shape (G,) on every model of a loop, with the margins of the linear loops, shape (D, G)."""
    return with_margins(task, loop, gains, loop.figures(gains, task.setpoint))


def with_margins(task: Task, loop: Loop, gains: Gains, figures: LoopFigures) -> LoopFigures:
    """The figures with the margins of the linear loops."""
    safe = margins(gains, loop.linear(), task.ecu)
    return replace(figures, gain_margin_db=safe.gain_db, phase_margin_deg=safe.phase_deg)


def unit_by_unit(task: Task, loop: Loop, units: tuple[str, ...], gains: Gains, at_once: int) -> tuple[OneByOne, ...]:
    """Results on every model of a loop, by name, for each of the gains of shape (G,); computed in groups.

    Args:
        at_once: models whose responses are in memory together; the last group is padded, so that one compiled program
            serves all groups.
    """
    count = len(units)
    room = min(at_once, count + count % 2)
    rows: list[LoopFigures] = []
    for begin in range(0, count, room):
        found = over_models(task, loop.taking(np.minimum(np.arange(begin, begin + room), count - 1)), gains)
        shape = found.rmse_pct.shape
        rows.append(found.each(lambda figure, shape=shape: np.broadcast_to(figure, shape)))
    joined = ((symbol, np.concatenate([getattr(row, symbol) for row in rows])[:count]) for symbol in FIGURES)
    every = LoopFigures(**dict(joined))
    return tuple(OneByOne(units, every.each(lambda figure, k=k: figure[:, k]), task.requirements)
                 for k in range(np.size(gains[0])))  # fmt: skip


def _tuned(task: Task, name: str, gains: Gains, share: np.ndarray, figures: LoopFigures, anew: LoopFigures) -> Tuned:
    """The result of one rule: responses of the draws, shape (D, K), their figures, and those under other noise."""
    requirements, time = task.requirements, task.setpoint.instants(task.ecu.period)
    gain, phase = (float(m) for m in margins(gains, task.plant, task.ecu))
    straight = respond(task.plant, gains, task.ecu, PAPERS_SETPOINT)
    follows = judge(PAPERS_SETPOINT, PAPERS_SETPOINT.instants(task.ecu.period), straight)
    linear = replace(follows.each(float), gain_margin_db=gain, phase_margin_deg=phase)
    nonlinear = replace(figures.each(lambda of: float(of[0])), gain_margin_db=gain, phase_margin_deg=phase)
    stable = (figures.gain_margin_db >= requirements.gain_margin_db) & (
        figures.phase_margin_deg >= requirements.phase_margin_deg
    )
    each = judge_each(task.setpoint, time, share[0])
    return Tuned(
        rule=name,
        gains=Gains(*(float(g) for g in gains)),
        why="",
        linear=linear,
        nonlinear=nonlinear,
        scenarios={scenario: figures.each(float) for scenario, figures in each.items()},
        met={symbol: bool(met) for symbol, met in requirements.met(nonlinear).items()},
        met_linear={symbol: bool(met) for symbol, met in requirements.met(linear, OF_THE_PAPER).items()},
        probability_met=float(np.mean(requirements.all_met(anew))),
        probability_stable=float(np.mean(stable)),
        band=np.quantile(share, (0.025, 0.5, 0.975), axis=0),
    )
