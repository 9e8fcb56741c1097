"""What a rule misses of its requirements and where, and the one verdict on gains in a sentence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import runs
from etcfit.control.judged import Tuned
from etcfit.control.loop_figures import LoopFigures
from etcfit.control.pid import Requirements
from etcfit.reporting.control.sentence import UNSTABLE, cautions, hardest, hardest_place, misses, sentence, withheld
from partial import partial

FAR = "the model is far from the data (chi2/dof 17)"
FIT = {"chi2_per_dof": 17.0, "converged": True, "reason": "gradient zero", "compromise": FAR}
RUSEFI = {"title": "rusEFI", "gains": {"etb_pFactor": {"value": 14.42894, "unit": "%/%"},
                                       "etb_iFactor": {"value": 267.13925, "unit": "%/%, per s"}}}  # fmt: skip


def pid(**changes: Any) -> dict[str, Any]:
    """Gains that meet everything at the bench, and overshoot in the worst corner."""
    figures = {"overshoot_pct": 12.0, "settling_s": 0.16, "steady_state_error_pct": 0.3}
    conditions = {
        "worst": figures | {"overshoot_pct": 53.8},
        "hardest": {"supply_V": 9.0, "winding_degC": -20.0, "friction_over_bench": 0.5},
        "met": {}, "stable": True, "probability_met": 0.46,
    }  # fmt: skip
    met = dict.fromkeys(figures, True)
    return runs.pid("optimal") | {"nonlinear": figures, "met": met, "conditions": conditions} | changes


def test_the_worst_corner_and_its_probability_stand_beside_the_bench() -> None:
    assert sentence(pid(profile=RUSEFI)) == (
        "The gains of optimal for rusEFI, etb_pFactor 14.43 %/%, etb_iFactor 267.1 %/% per s, meet every requirement "
        "on the nominal model; in the worst corner outside the bench they MISS: overshoot 53.8 % (limit 20 %), hardest "
        "at 9 V, winding at -20 °C, dry friction 0.5 times the bench's; under all such conditions they meet everything "
        "with probability 0.46."
    )


def test_gains_stand_in_the_unit_of_rig_toml_or_in_si_where_no_make_is_named() -> None:
    assert "P 6.500, I 0.2250, D 47.10 (%/%, ticks)" in sentence(pid())
    assert "Kp 6.017 V/rad, Ki 103.9 V/(rad s), Kd 0.08710 V s/rad" in sentence(pid(as_written=None))


def test_a_corner_that_is_met_says_how_narrowly() -> None:
    found = pid()
    found["conditions"]["worst"]["overshoot_pct"] = 15.0
    assert "outside the bench they meet every requirement too, most narrowly settling time 0.160 s" in sentence(found)


def test_what_is_missed_or_unstable_is_no_success() -> None:
    missed = pid(nonlinear={"overshoot_pct": 25.0, "settling_s": None, "phase_margin_deg": 12.0},
                 margins_asked={"phase_margin_deg": 30.0})  # fmt: skip
    said = sentence(missed)
    assert ("MISS on the nominal model: overshoot 25.0 % (limit 20 %), settling: never (limit 0.2 s) and phase "
            "margin 12.0 degrees (at least 30 degrees)") in said  # fmt: skip
    assert "meet every requirement" not in said
    assert "UNSTABLE on the nominal model" in sentence(pid(stable=False))
    shaky = pid()
    shaky["conditions"]["stable"] = False
    assert "the loop is UNSTABLE, at 9 V" in sentence(shaky)


def test_gains_of_a_compromise_are_withheld_until_they_are_asked_for_all_the_same() -> None:
    found = pid(profile=RUSEFI, fit=FIT)
    assert withheld(found)
    said = sentence(found)
    assert said.startswith("No gains for an ECU. The parameters behind this are a compromise")
    assert "etcfit diagnose" in said
    assert "--anyway" in said
    assert not any(word in said for word in ("14.43", "meet", "probability"))
    asked = sentence(found | {"anyway": True})
    assert asked.startswith(f"{cautions(found)[0]} The gains of optimal for rusEFI, etb_pFactor 14.43 %/%")
    assert asked.endswith("of such a model that says little of the plant.")
    assert "probability" not in asked


def test_a_fit_that_did_not_converge_is_no_estimate_either() -> None:
    assert withheld(pid(fit=FIT | {"converged": False, "compromise": None}))
    assert not withheld(pid(fit=FIT | {"compromise": None}))
    assert not withheld(pid())


@pytest.mark.parametrize("kind", ["fleet", "parts"])
def test_units_are_counted_where_a_fleet_tells_them(kind: str) -> None:
    parts = {"name": "line 4", "rules": {"optimal": {"drawn": {"share_met": 0.375}}}}
    told = {"fleet": {"says": "59 of 60 units meet everything"}, "parts": parts}
    said = {"fleet": "59 of 60 units meet everything", "parts": "on 38 % of parts drawn from the fleet “line 4”"}
    assert said[kind] in sentence(pid(**{kind: told[kind]}))


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
    assert never.says == "settling: never (limit 0.2 s)"
