"""Which of several effects is chosen: numbers in, a choice and its reason out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from diagnoses import score, verdict
from etcfit.diagnosis.choice import (
    Choice,
    Outcome,
    alike,
    choose,
    deserves_second_trial,
    first_of,
    in_turn,
    is_accepted,
    promises,
    promising,
)
from etcfit.diagnosis.formula_errors import FormulaErrors, Stretch
from etcfit.diagnosis.screen import Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import variants
from etcfit.diagnosis.trial import Cost, TrialVerdict
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import rig_effect

LIMP, STRIBECK, GRAVITY, DRAG, BACKLASH = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "stribeck_friction", "gravity_load", "quadratic_drag", "backlash")
)
SETTINGS = DiagnosisSettings()
STRONG = SETTINGS.strong_bic_change


def chosen(*verdicts: TrialVerdict, **limits: float) -> Choice:
    return choose(verdicts, SETTINGS, **limits)


# ---- is it worth a refit?


def free(_: Any) -> Cost:
    return Cost(0, 1)


def signature(gain: float, effect: Any = GRAVITY) -> Signature:
    return Signature(variants(effect)[0], np.zeros((1, len(effect.off))), gain, {}, 1.0)


@pytest.mark.parametrize(("share", "worth"), [(0.49, False), (0.51, True)])
@pytest.mark.parametrize("formula", [False, True])
def test_a_promise_must_come_near_what_bic_requires(formula: bool, share: float, worth: bool) -> None:
    """k ln n + 2 ln(variants) + 10 in -2 log likelihood, one unit of chi2 being worth n / chi2 of it; 70 beside a
    formula that is not exact."""
    before = score(2000.0)
    if formula:
        before = replace(before, errors=FormulaErrors((Stretch.of_columns(np.arange(1), np.ones((1, 1))),)))
    required = 3.0 * math.log(1000.0) + 2.0 * math.log(5.0) + (70.0 if formula else 10.0)
    assert promises(signature(share * required * 2.0), Cost(3, 5), before, SETTINGS) is worth


@pytest.mark.parametrize(("far", "kept"), [(False, [100.0, 80.0, 31.0]), (True, [100.0, 80.0, 31.0, 29.0])])
def test_only_rivals_of_the_best_promise_are_refitted_and_four_at_most(far: bool, kept: list[float]) -> None:
    every = [signature(gain) for gain in (100.0, 80.0, 31.0, 29.0, 28.0, 9.0)]
    assert [g.gain for g in promising(every, score(1000.0), far, free, SETTINGS)] == kept


def test_single_channels_of_traces_leave_room_to_whole_tests_and_are_refitted_after_them() -> None:
    single = [rig_effect(f"channel_gain[response/{k}.csv.current]") for k in range(5)]
    whole = [
        rig_effect(f"channel_gain[{test}.current]") for test in ("response", "viscous", "inductance", "resistance")
    ]
    every = [*(signature(100.0, e) for e in single), *(signature(90.0, e) for e in whole)]
    kept = [g.variant.effect for g in promising(every, score(1000.0), False, free, SETTINGS)]
    assert set(kept) == {*single[:3], *whole[:3]}
    assert [g.variant.effect for g in first_of(every, 4, SETTINGS)] == [*whole, *single[:3]]


def test_without_a_promise_nothing_is_refitted() -> None:
    assert promising([], score(1000.0), False, free, SETTINGS) == []
    assert promising([signature(1.0), signature(0.9)], score(1000.0), False, free, SETTINGS) == []


# ---- the choice


def test_without_a_verdict_nothing_is_added() -> None:
    assert chosen() == Choice(
        Outcome.NO_PROMISE, None, (), "No effect of the catalogue promises to explain anything more."
    )


def test_what_is_not_worth_its_parameters_is_not_added() -> None:
    found = chosen(verdict(LIMP, STRONG + 0.1), verdict(GRAVITY, 3.0))
    assert (found.outcome, found.effect, found.ties) == (Outcome.NOT_WORTH_IT, None, ())
    assert (
        found.why
        == "limp_home_spring is the best candidate, but is not worth its parameters (BIC -9.9; -10 is required)."
    )


def test_what_helps_the_fitted_traces_only_is_not_added() -> None:
    found = chosen(verdict(LIMP, -500.0, holdout_chi2_change=20.0), verdict(GRAVITY, -20.0, holdout_rms_ratio=1.2))
    assert (found.outcome, found.effect, found.ties) == (Outcome.CONTRADICTED, None, ())
    assert found.why == "limp_home_spring improves the fitted traces only, not the held-out ones."


def test_the_best_by_bic_is_added_and_what_it_does_is_said() -> None:
    found = chosen(verdict(LIMP, -500.0), verdict(GRAVITY, -400.0, chi2=950.0), verdict(DRAG, 1.0))
    assert (found.outcome, found.effect, found.ties) == (Outcome.ADDED, LIMP, ())
    assert found.why == "limp_home_spring explains most: fitted error x 0.700, held-out error x 0.800, BIC -500."


def test_the_best_of_those_that_help_elsewhere_is_added() -> None:
    contradicted = verdict(STRIBECK, -503.0, holdout_chi2_change=1.1)
    found = chosen(contradicted, verdict(LIMP, -500.0), verdict(DRAG, -30.0, chi2=990.0))
    assert (found.effect, found.ties) == (LIMP, ())


def test_without_held_out_traces_their_error_is_not_spoken_of() -> None:
    found = chosen(verdict(LIMP, -500.0, holdout_rms_ratio=None, holdout_chi2_change=None))
    assert found.effect is LIMP
    assert "held-out" not in found.why


def test_beside_inexact_formulas_seven_times_the_evidence_is_required() -> None:
    assert chosen(replace(verdict(LIMP, 7.1 * STRONG), beside_formulas=True)).effect is LIMP
    found = chosen(replace(verdict(LIMP, 6.9 * STRONG), beside_formulas=True))
    assert found.outcome is Outcome.NOT_WORTH_IT
    assert found.why.endswith("(BIC -69.0; -70 is required).")


@pytest.mark.parametrize(("noise", "added"), [(401.0, LIMP), (399.0, None)])
def test_an_effect_that_explains_less_than_a_fifth_of_what_it_leaves_is_not_added(noise: float, added: Any) -> None:
    """It gains 100 and leaves 900; another that gains more helps on the fitted traces only."""
    contradicted = verdict(GRAVITY, -600.0, holdout_chi2_change=500.0, gain=400.0)
    found = chosen(contradicted, verdict(LIMP, -500.0), noise=noise)
    assert (found.effect, found.ties) == (added, ())
    if added is None:
        assert found.outcome is Outcome.SMALL_PART
        assert found.why.startswith(
            "limp_home_spring is the best candidate, but explains less than 20 % of what it leaves"
        )


def test_an_effect_that_spoils_the_full_refit_is_not_added() -> None:
    before = chosen(verdict(LIMP, -500.0), verdict(GRAVITY, -498.0))
    assert before.ties == (GRAVITY,)
    after = before.with_refit_refused()
    assert (after.outcome, after.effect, after.ties) == (Outcome.SPOILT, None, ())
    assert after.why == (f"{before.why} A full refit with it leaves the model further from the data: it is not added.")


def test_those_that_stand_are_chosen_in_turn() -> None:
    """Were the best not there, the next that stands; the one contradicted elsewhere never."""
    every = [verdict(LIMP, -500.0), verdict(STRIBECK, -400.0, holdout_rms_ratio=2.0), verdict(GRAVITY, -300.0)]
    choices = in_turn(every, SETTINGS)
    assert [c.effect for c in choices] == [LIMP, GRAVITY]
    assert choices[0] == choose(every, SETTINGS)
    assert choices[1] == choose(every[1:], SETTINGS)


def test_where_none_stands_the_only_choice_says_so() -> None:
    (choice,) = in_turn([verdict(LIMP, -9.0)], SETTINGS)
    assert choice.outcome is Outcome.NOT_WORTH_IT


# ---- ties


def test_effects_whose_inexact_formulas_could_make_the_difference_are_ties() -> None:
    """2 % of what was explained, squared, and never more than 4 % of the noise's."""
    every = [
        verdict(LIMP, -5000.0, gain=5e4),
        verdict(GRAVITY, -4980.0, chi2=919.0),
        verdict(DRAG, -4970.0, chi2=921.0),
    ]
    assert chosen(*every).ties == (GRAVITY,)
    every = [
        verdict(LIMP, -5000.0, gain=5e6),
        verdict(GRAVITY, -4960.0, chi2=939.0),
        verdict(DRAG, -4950.0, chi2=941.0),
    ]
    assert chosen(*every).ties == (GRAVITY,)


def test_effects_that_do_as_well_are_ties() -> None:
    """Within 6 of the best's -2 log likelihood, worth their parameters, and not contradicted by held-out traces."""
    found = chosen(
        verdict(LIMP, -500.0),
        verdict(GRAVITY, -490.0),
        verdict(STRIBECK, -498.0, holdout_chi2_change=5.0),
        verdict(BACKLASH, -494.1, chi2=905.3),
        verdict(DRAG, -493.9, chi2=905.5),
    )
    assert found.effect is LIMP
    assert [e.name for e in found.ties] == ["gravity_load", "backlash"]
    assert found.why.endswith("gravity_load and backlash would explain as much: these data cannot tell them apart.")


def test_what_is_not_worth_it_is_no_tie() -> None:
    found = chosen(verdict(LIMP, -12.0), verdict(GRAVITY, -9.0))
    assert (found.effect, found.ties) == (LIMP, ())


def test_what_a_formula_leaves_is_measured_by_what_the_better_one_explained() -> None:
    assert LIMP.inexact == DRAG.inexact == 0.02
    best, apart = verdict(LIMP, -40.0, gain=3e4), 10.0  # 2 % squared of 3e4 is 12
    assert alike(verdict(DRAG, -9.0, chi2=900.0 + apart), best)
    assert not alike(verdict(DRAG, -9.0, chi2=900.0 + apart, gain=3e4), verdict(LIMP, -40.0, gain=2e4))


@pytest.mark.parametrize(("bic", "even"), [(-34.1, True), (-33.9, False)])
def test_one_that_fits_worse_with_fewer_parameters_is_as_likely(bic: float, even: bool) -> None:
    best = verdict(LIMP, -40.0, gain=100.0)
    assert alike(verdict(GRAVITY, bic, chi2=910.0), best) is even


# ---- contradicted, and yet enough of what is left

MAIN = {"gain": 49_000.0, "chi2": 6_000.0}  # 5000 of them above the noise


@pytest.mark.parametrize(
    ("far", "first", "asked"),
    [
        (False, {"holdout_rms_ratio": 1.5}, True),
        (False, {"holdout_chi2_change": 600.0}, True),
        (False, {"holdout_rms_ratio": 1.5, "gain": 1_010.0}, True),
        (False, {"holdout_rms_ratio": 1.5, "gain": 990.0}, False),
        (False, {"holdout_rms_ratio": 1.01}, False),
        (True, {"holdout_rms_ratio": 1.5}, False),
    ],
    ids=[
        "worse elsewhere",
        "contradicted elsewhere",
        "just enough of it",
        "not enough of it",
        "never contradicted",
        "far from the data",
    ],
)
def test_what_explains_enough_but_is_contradicted_is_judged_again(far: bool, first: Any, asked: bool) -> None:
    v = verdict(LIMP, -500.0, **(MAIN | first))
    assert deserves_second_trial(v, far, SETTINGS) is asked


def test_what_is_not_worth_its_parameters_is_not_judged_again() -> None:
    v = verdict(LIMP, -9.0, holdout_rms_ratio=1.5, **MAIN)
    assert not deserves_second_trial(v, False, SETTINGS)


@pytest.mark.parametrize(
    ("again", "kept"),
    [({"holdout_rms_ratio": 1.1}, True), ({"holdout_rms_ratio": 1.3}, False), ({"holdout_chi2_change": 600.0}, False)],
    ids=["as well elsewhere", "still worse", "still contradicted"],
)
def test_after_a_full_refit_a_held_out_error_may_rise_by_a_fifth(again: Any, kept: bool) -> None:
    v = verdict(LIMP, -400.0, gain=40_000.0, slack=SETTINGS.rise_in_refit(False), **again)
    assert is_accepted(v, SETTINGS) is kept
    assert not is_accepted(verdict(LIMP, -9.0), SETTINGS)
