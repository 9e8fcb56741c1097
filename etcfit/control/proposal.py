"""New gains in steps from the gains that are in the ECU now: a safe half-way step first, then the proposed gains.

    half way:  g = g_present^(1 - w) g_proposed^w, gain by gain; w g_proposed where the present gain is 0

w is 1/2, unless the margins there are smaller than at both ends, which may happen with more D and little of the new P.
Then w is the next of 0.65, 0.35, 0.8 and 0.2 for which they are not smaller; if there is none, the one with the largest
margins.

The effect of each step is computed on the fitted model in every scenario of the design, over all of its draws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .design import Design
from .judged import with_margins
from .loop_figures import LoopFigures, judge_each
from .pid import Gains
from .pid.linear_loop import margins

PRESENT, HALF_WAY, PROPOSED = "present", "half_way", "proposed"
SHOWN = "large steps"  # the scenario that is drawn, and with which a next log is compared
WAYS = (0.5, 0.65, 0.35, 0.8, 0.2)  # values of w that are tried, the preferred one first
_ROUNDING = 1e-9
MOST_UNHELD = 10.0  # largest error at the end of a large step, % of the step, with which a model may be used for tuning


@dataclass(frozen=True, eq=False)
class GainStep:
    """The prediction of the model for one set of gains."""

    name: str  # PRESENT, HALF_WAY or PROPOSED
    gains: Gains  # SI
    figures: LoopFigures  # of the nominal model, the worst of all scenarios
    scenarios: Mapping[str, LoopFigures]  # of the nominal model, by scenario
    overshoot: tuple[float, float, float]  # of the large steps, 2.5, 50 and 97.5 % of the draws, %
    settling: tuple[float, float, float]  # the same, s; infinite where it does not settle
    error: tuple[float, float, float]  # rms of setpoint - position over the large steps, the same, % of the travel
    probability_met: float  # share of the draws that meet every requirement
    probability_stable: float  # share of the draws whose linear loop is stable
    # share of the draws on which it tracks better than the present gains; None for the present gains, or without them
    better: float | None
    time: np.ndarray  # of the large steps, s from their begin, shape (K,)
    setpoint: np.ndarray  # setpoint there, share of the travel, shape (K,)
    position: np.ndarray  # of the nominal model there, share of the travel, shape (K,)


def half_way(present: Gains, proposed: Gains, share: float = WAYS[0]) -> Gains:
    """The half-way gains of the module's formula; `share` is w."""
    return Gains(*(a ** (1.0 - share) * b**share if a > 0.0 else share * b
                   for a, b in zip(present, proposed, strict=True)))  # fmt: skip


def safe_half_way(design: Design, present: Gains) -> Gains:
    """The half-way gains whose margins, the least over all draws, are no smaller than those of the worse end.

    A margin above the required one counts as the required one.
    """
    task, requirements = design.task, design.task.requirements
    ways = [half_way(present, design.proposed, share) for share in WAYS]
    safe = margins(Gains.stacked(present, design.proposed, *ways), task.loop.linear(), task.ecu)
    share = np.minimum(
        np.minimum(safe.gain_db / requirements.gain_margin_db, safe.phase_deg / requirements.phase_margin_deg), 1.0
    )
    least = np.min(share, axis=0)
    good = np.flatnonzero(least[2:] >= np.min(least[:2]) - _ROUNDING)
    return ways[int(good[0] if good.size else np.argmax(least[2:]))]


def gain_steps(design: Design, present: Gains | None) -> tuple[GainStep, ...]:
    """The present, the half-way and the proposed gains; the last alone where the present gains are unknown."""
    every = {PROPOSED: design.proposed}
    if present is not None:
        every = {PRESENT: present, HALF_WAY: safe_half_way(design, present), **every}
    task = design.task
    stacked = Gains.stacked(*every.values())
    loop = task.loop.with_new_noise_seed() if task.ecu.noise > 0.0 else task.loop
    share, figures = loop.tried(stacked, task.setpoint)
    found = with_margins(task, loop, stacked, figures)
    time = task.setpoint.instants(task.ecu.period)
    levels = task.setpoint.only(SHOWN)
    seen = (time >= levels[0].begins - 0.1) & (time < levels[-1].ends)
    steps = []
    for k, (name, gains) in enumerate(every.items()):
        one, each = found.of_gains(k), judge_each(task.setpoint, time, share[:, k])
        better = (
            float(np.mean(one.rmse_pct < found.of_gains(0).rmse_pct)) if name != PRESENT and len(every) > 1 else None
        )
        steps.append(GainStep(
            name, Gains(*(float(gain) for gain in gains)), one.each(_nominal),
            {scenario: figures.each(_nominal) for scenario, figures in each.items()},
            _spread(each[SHOWN].overshoot_pct), _spread(each[SHOWN].settling_s), _spread(each[SHOWN].rmse_pct),
            float(np.mean(task.requirements.all_met(one))), float(np.mean(one.gain_margin_db > 0.0)), better,
            time[seen] - levels[0].begins, task.setpoint.at(time[seen]), share[0, k, seen],
        ))  # fmt: skip
    return tuple(steps)


def _nominal(figure: np.ndarray) -> float:
    """Figure of the first model."""
    return float(figure[0])


def not_held(steps: Sequence[GainStep]) -> str:
    """Why the model cannot be used for tuning: with these gains its plate never reaches the setpoint; otherwise "".

    Target and position alone do not determine the preload, because the integral compensates any preload: with a wrong
    one the duty of the model reaches its limit.
    """
    if steps[-1].scenarios[SHOWN].steady_state_error_pct < MOST_UNHELD:
        return ""
    return (
        "With the proposed gains the model's plate does not reach a step of 10 to 70 % of the travel: these logs do "
        "not determine its preload. Log the duty at the rate of the ECU's clock."
    )


def _spread(figures: np.ndarray) -> tuple[float, float, float]:
    """2.5, 50 and 97.5 % of the draws; each is one of the draws, so that an infinite figure stays infinite."""
    low, middle, high = np.quantile(figures, (0.025, 0.5, 0.975), method="nearest")
    return float(low), float(middle), float(high)
