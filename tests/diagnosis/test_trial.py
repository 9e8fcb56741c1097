"""What a trial is judged by; scores and verdicts made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import diagnoses
from diagnoses import score, verdict
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import alike
from etcfit.diagnosis.composition import Composition, Effect
from etcfit.diagnosis.findings import Candidate, Evidence, RoundReport
from etcfit.diagnosis.probabilities import probabilities, questions
from etcfit.diagnosis.score import score as score_of
from etcfit.diagnosis.settings import DEFAULT, DiagnosisSettings
from etcfit.diagnosis.tangents import variants
from etcfit.diagnosis.trial import Cost, bic_change, compare, run_trial, second_trial, surprise
from etcfit.estimation.rounds import deviance
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import rig_effect
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.base import RigConfig

LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))
SETTINGS = DiagnosisSettings()

# ---- what a parameter costs


def test_bic_is_likelihood_plus_parameters_plus_the_choice_among_variants() -> None:
    change = bic_change(score(2000.0, 800.0), score(1000.0, 900.0), Cost(3, 6))
    assert change == pytest.approx(800.0 * math.log(0.5) + 3.0 * math.log(800.0) + 2.0 * math.log(6.0))


def test_a_parameter_that_explains_nothing_costs_the_log_of_the_samples() -> None:
    before = score(1000.0)
    assert bic_change(before, before, Cost(1, 1)) == pytest.approx(math.log(1000.0))
    assert bic_change(before, before, Cost(0, 1)) == 0.0
    many, one = bic_change(before, before, Cost(2, 4)), bic_change(before, before, Cost(2, 1))
    assert many > one > bic_change(before, before, Cost(1, 1))
    # a residual of noise falls by one of 1000 for each parameter: nowhere near worth it
    assert bic_change(before, score(999.0), Cost(1, 1)) > 0.0


def test_the_scale_of_the_noise_is_not_trusted() -> None:
    """Weighed by the error left in them, chi2 of all samples may be any size: its logarithm counts."""
    small, large = (bic_change(score(c), score(0.9 * c), Cost(1, 1)) for c in (1e-3, 1e5))
    assert small == pytest.approx(large)


def test_an_effect_costs_its_parameters_and_its_variants() -> None:
    """Four parameters, and as many variants as `scan` lists."""
    alone = Composition(free_parameters(RigConfig("by hand")), (), (LIMP,))
    assert Cost.of_effect(LIMP, alone).parameters == 4
    assert Cost.of_effect(LIMP, alone).variants == math.prod(len(values) for values in LIMP.scan.values())
    assert Cost.of_effect(GRAVITY, alone) == Cost(1, 1)


# ---- the verdict


def test_a_verdict_compares_what_both_models_have() -> None:
    """Held-out errors only where there are any."""
    before, after = score(2000.0, held_out=900.0, rms=4.0), score(1000.0, held_out=600.0, rms=3.0)
    found = compare(LIMP, before, after, Cost(4, 6), 1000.0, 0.02)
    alone = compare(LIMP, score(2000.0, rms=4.0), after, Cost(4, 6))
    assert (found.fit_rms_ratio, found.holdout_rms_ratio) == (0.75, 0.75)
    assert found.holdout_chi2_change == -300.0
    assert found.gain == 1000.0
    assert found.bic_change == bic_change(before, after, Cost(4, 6))
    assert (found.samples, found.slack) == (1000.0, 0.02)
    assert (alone.holdout_rms_ratio, alone.holdout_chi2_change) == (None, None)


@pytest.mark.parametrize(
    ("held_out", "ratio", "slack", "helps"),
    [
        (None, None, 0.02, True),
        (-1.0, 0.9, 0.02, True),
        (1.1, 0.9, 0.02, False),
        (0.9, 0.9, 0.02, True),  # of the 100 that it gains on the fitted ones
        (-1.0, 1.01, 0.02, True),
        (-1.0, 1.03, 0.02, False),
        (-1.0, 2.9, 2.0, True),  # far from the data
        (-1.0, 3.1, 2.0, False),
        (-1.0, None, 0.02, True),
        (-1.0, math.nan, 0.02, False),
    ],
)
def test_held_out_traces_must_not_contradict(
    held_out: float | None, ratio: float | None, slack: float, helps: bool
) -> None:
    v = verdict(LIMP, -100.0, holdout_chi2_change=held_out, holdout_rms_ratio=ratio, slack=slack)
    assert v.helps_elsewhere() is helps


def test_a_worse_free_run_contradicts_no_effect_that_leaves_noise_on_the_held_out_traces() -> None:
    """Their chi2 must not rise all the same."""
    for change, helps in ((0.9, True), (1.1, False)):
        v = verdict(LIMP, -100.0, holdout_chi2_change=change, holdout_rms_ratio=1.5, held_out_noise=True)
        assert v.helps_elsewhere() is helps


@pytest.mark.parametrize(("bic", "strong"), [(-10.1, True), (-10.0, False), (-9.9, False), (math.nan, False)])
def test_only_a_bic_that_falls_by_more_than_ten_is_strong(bic: float, strong: bool) -> None:
    assert verdict(LIMP, bic).is_strong(SETTINGS) is strong


# ---- a real trial


@pytest.mark.slow
def test_an_effect_is_refitted_and_compared_with_the_model_without_it(small: CandidateModel) -> None:
    before = score_of(small)
    trial = run_trial(small, GRAVITY, {"T_g": 0.01}, before)
    v = trial.verdict
    assert trial.model.at_work(GRAVITY)
    assert trial.model.values["T_g"] != 0.0
    assert v.effect is GRAVITY
    assert v.gain == pytest.approx(small.chi2 - trial.model.chi2)
    assert v.gain > 0.0
    assert v.bic_change == bic_change(before, v.score, Cost(1, 1))
    assert (v.samples, v.slack) == (small.weighted.samples, SETTINGS.rise_in_trial(False))
    assert v.holdout_rms_ratio is not None
    assert before.holdout_rms is not None
    assert v.holdout_rms_ratio == pytest.approx(np.divide(v.score.holdout_rms or np.nan, before.holdout_rms))
    # at the coordinates of another refit: its held-out figures, which may rise by a fifth, and the better fit of both
    worse = small.with_effects((GRAVITY,), {"T_g": 0.01})
    again = second_trial(trial, worse, small, before)
    elsewhere = score_of(replace(trial.model, x=worse.x))
    assert again.model is trial.model
    assert again.verdict.gain == v.gain
    assert again.verdict.holdout_rms_ratio == pytest.approx(
        np.divide(elsewhere.holdout_rms or np.nan, before.holdout_rms)
    )
    assert again.verdict.slack == SETTINGS.refit_rise
    # held out, the fitted trace itself: of chi2 by the whitening before and of -2 log L the one that rises less
    assert small.holdout is not None
    assert worse.holdout is not None
    likelier = deviance(*worse.holdout, worse.x) - deviance(*small.holdout, small.x)
    by_whitening = np.subtract(elsewhere.held_out or np.nan, before.held_out or np.nan)
    assert again.verdict.holdout_chi2_change == pytest.approx(min(likelier, by_whitening))
    # and the other way round
    first = replace(trial, model=worse, verdict=replace(v, score=elsewhere))
    assert second_trial(first, trial.model, small, before).model.values["T_g"] == trial.model.values["T_g"]


def test_an_effect_of_the_rig_pays_for_all_the_places_where_it_could_have_been() -> None:
    gain, resistor = (rig_effect(name) for name in ("channel_gain[response.current]", "series_resistance[viscous]"))
    assert gain is not None
    assert resistor is not None
    composition = Composition(free_parameters(RigConfig("by hand")), (), (gain, resistor, LIMP))
    assert Cost.of_effect(gain, composition).variants == 2 * len(variants(gain))
    assert Cost.of_effect(LIMP, composition).variants == len(variants(LIMP))


# ---- What is known of a mistake before the data: its usual size, and whether the checks found it


def effect(name: str) -> Effect:
    found = rig_effect(name)
    assert found is not None
    return found


GAIN, RESISTOR = effect("channel_gain[inductance.voltage]"), effect("series_resistance[inductance]")
VALUES = {"gain.inductance.voltage": 0.74, "series_ohm.inductance": 1.2}


def test_a_mistake_of_an_unusual_size_pays_for_it() -> None:
    assert surprise(GAIN, VALUES, ()) == pytest.approx(2.0 * math.log(1.0 + (0.74 / 0.02) ** 2))
    assert surprise(RESISTOR, VALUES, ()) == pytest.approx(2.0 * math.log(1.0 + 1.2**2))
    assert surprise(GAIN, VALUES | {"gain.inductance.voltage": 0.0}, ()) == 0.0


def test_what_the_checks_found_is_ten_times_as_probable() -> None:
    assert surprise(RESISTOR, VALUES, (RESISTOR,)) - surprise(RESISTOR, VALUES, ()) == pytest.approx(-2 * math.log(10))


def test_one_channel_of_one_trace_is_25_times_less_probable_than_that_of_its_test() -> None:
    test, trace = effect("channel_gain[static_load.current]"), effect("channel_gain[static_load/ramp_1.csv.current]")
    values = {"gain.static_load.current": 0.05, "gain.static_load/ramp_1.csv.current": 0.05}
    assert surprise(trace, values, ()) - surprise(test, values, ()) == pytest.approx(2.0 * math.log(25.0))


def test_an_effect_of_the_throttle_pays_nothing_of_any_size() -> None:
    limp = EFFECT_BY_NAME["limp_home_spring"]
    assert surprise(limp, dict.fromkeys(limp.off or {}, 99.0), ()) == 0.0


def test_a_mistake_far_less_usual_is_no_tie_however_alike_the_fits() -> None:
    best = replace(diagnoses.verdict(RESISTOR, -1000.0), prior=0.0)
    for prior, tied in ((4.0, True), (20.0, False)):
        other = replace(diagnoses.verdict(GAIN, -1000.0 + prior), prior=prior)
        assert alike(other, best) is tied


def test_the_prior_is_not_tempered() -> None:
    candidates = tuple(Candidate(name, 1.0, 1.0, True, bic_change=b, prior=q)
                       for name, b, q in (("a", -1000.0, 0.0), ("b", -988.0, 12.0)))  # fmt: skip
    turned = RoundReport((), Evidence((), True, (), ()), 1.0, 1.0, candidates, "a", (), "")
    of_round = [turned], ["a"], False, DEFAULT
    p = probabilities(questions(*of_round), *of_round)
    assert p["b"] / p["a"] == pytest.approx(math.exp(-6.0))
