"""Which requirement a rule misses by most, and in which scenario."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from etcfit.control.judged import Tuned
from etcfit.control.loop_figures import LoopFigures
from etcfit.control.pid import Requirements
from etcfit.reporting.control.sentence import UNSTABLE, hardest, hardest_place, misses
from partial import partial

GOOD = LoopFigures(10.0, 0.1, 0.2, 1.0, 12.0, 45.0, 4.0)
SCENARIOS = {"large": LoopFigures(5.0, 0.1, 0.1, 12.0), "small": LoopFigures(30.0, 0.1, 0.1, 0.2),
             "log": LoopFigures(float("nan"), float("nan"), float("nan"), 1.0)}  # fmt: skip


def tuned(stable: bool = True, **changes: Any) -> Tuned:
    figures = replace(GOOD, **changes)
    linear = figures if stable else replace(figures, gain_margin_db=-1.0)
    return partial(Tuned, linear=linear, nonlinear=figures, scenarios=SCENARIOS)


def test_the_worst_comes_first_and_margins_come_last() -> None:
    said = misses(tuned(overshoot_pct=30.0, duty_activity_pct=20.0, phase_margin_deg=12.0), Requirements())
    assert said == ["duty activity at rest 20.0 % (limit 5 %)", "overshoot 30.0 % (limit 20 %)",
                    "phase margin 12.0 degrees (at least 30 degrees)"]  # fmt: skip
    assert misses(tuned(duty_activity_pct=20.0), Requirements(), ("duty_activity_pct",)) == []
    assert misses(tuned(), Requirements()) == []
    assert misses(tuned(stable=False), Requirements()) == [UNSTABLE]


def test_a_figure_at_its_limit_is_missed() -> None:
    assert misses(tuned(overshoot_pct=20.0), Requirements()) == ["overshoot 20.0 % (limit 20 %)"]


def test_the_hardest_scenario_is_that_of_the_worst_figure() -> None:
    place = hardest_place(tuned(), Requirements())
    assert place is not None
    assert (place.scenario, place.hardest.symbol, place.hardest.met) == ("small", "overshoot_pct", False)
    only_log = partial(Tuned, scenarios={"log": SCENARIOS["log"]})
    assert hardest_place(only_log, Requirements()) is None


def test_what_has_no_limit_or_no_figure_is_not_judged() -> None:
    assert hardest({"winding_W": 3.0}, {"winding_W": None, "settling_s": 0.2}) is None
    never = hardest({"settling_s": None}, {"settling_s": 0.2})
    assert never is not None
    assert not never.met
    assert never.says == "no settling (limit 0.2 s)"
