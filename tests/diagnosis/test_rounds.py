"""Rounds as data for the report, and how far a diagnosis has come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import results
from diagnoses import rounds, score, verdict
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import Choice, Outcome, choose
from etcfit.diagnosis.composition import Effect
from etcfit.diagnosis.course import final_fit
from etcfit.diagnosis.loop import Round, deeper_optimum, refit_chosen, run_round, starts_of
from etcfit.diagnosis.probabilities import probabilities, questions
from etcfit.diagnosis.rounds import (
    Near,
    Progress,
    find_masked_effect,
    forward,
    maskable,
    nearest,
    reported,
    round_and_model,
)
from etcfit.diagnosis.score import baseline
from etcfit.diagnosis.screen import Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import variants
from etcfit.diagnosis.trial import Trial, judge_trial
from etcfit.estimation.joint_fit import quiet
from etcfit.estimation.result import FitResult, Termination
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS
from etcfit.rig.base import Rig
from results import result

LIMP, GRAVITY, AIR, DRAG = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load", "airflow_torque", "quadratic_drag")
)


def refuse(text: str, share: float) -> None:
    pytest.fail(f"there was nothing to do: {text}")


def signature(effect: type, gain: float) -> Signature:
    return Signature(variants(effect)[0], np.zeros((1, 1)), gain, {}, 0.5)


@pytest.fixture(scope="module")
def turned(small: CandidateModel) -> Round:
    """Two effects tried of four; the one with the smaller promise has the lower BIC."""
    screened = (signature(LIMP, 90.0), signature(GRAVITY, 80.0), signature(AIR, 20.0), signature(DRAG, 30.0))
    trials = Trial(small, verdict(GRAVITY, -500.0)), Trial(small, verdict(LIMP, -498.0, holdout_rms_ratio=None))
    choice = Choice(Outcome.ADDED, GRAVITY, (LIMP,), "gravity_load explains most.")
    return Round(small, score(1000.0, held_out=5.0, rms=1.5), screened, trials, choice)


def test_a_round_is_reported_with_every_candidate_the_tried_ones_first(turned: Round) -> None:
    told = reported(turned)
    assert [c.effect for c in told.candidates] == [GRAVITY.name, LIMP.name, DRAG.name, AIR.name]
    first, second, third, _ = told.candidates
    assert (first.refitted, first.bic_change, first.fit_rms_ratio, first.holdout_rms_ratio) == (True, -500.0, 0.7, 0.8)
    assert (first.screened, first.own, first.holdout_chi2_change) == (80.0, 0.5, -50.0)
    assert second.holdout_rms_ratio is None
    assert (third.refitted, third.bic_change, third.fit_rms_ratio, third.screened) == (False, None, None, 30.0)


def test_a_round_is_reported_with_its_choice_and_the_model_that_it_began_with(turned: Round) -> None:
    told = reported(turned)
    assert (told.added, told.ties, told.why) == (GRAVITY.name, (LIMP.name,), turned.choice.why)
    assert (told.fit_rms, told.holdout_rms) == (pytest.approx(1.5), pytest.approx(1.5))
    assert told.effects == ()
    assert len(told.evidence.rows) == len(turned.before.problem.batch.traces[0].channels)
    nothing = reported(replace(turned, choice=turned.choice.with_refit_refused()))
    assert (nothing.added, nothing.ties) == (None, ())


def test_an_effect_that_was_refitted_unscreened_is_reported_with_what_the_refit_gained(turned: Round) -> None:
    """Else it had no probability: a check of the rig had found it, so that no round screened it."""
    told = replace(reported(replace(turned, screened=())), chi2_per_sample=1.0)  # its traces are invented
    assert [c.effect for c in told.candidates] == [GRAVITY.name, LIMP.name]
    first = told.candidates[0]
    assert (first.refitted, first.bic_change, first.screened) == (True, -500.0, turned.trials[0].verdict.gain)
    of_round = (told,), {GRAVITY.name}, False, DiagnosisSettings()
    assert probabilities(questions(*of_round), *of_round)[GRAVITY.name] > 0.4  # its tie as much


def test_a_round_begins_anew_where_the_model_before_gains_as_much_without_the_effect(small: CandidateModel) -> None:
    """Three names of one folder gained 250 of chi2 each, and none of it was theirs: the model before was not at its
    optimum."""
    shallow, deep = (replace(small, x=small.optimised().x + away).optimised() for away in (0.0, 0.5))
    before, choice = baseline(shallow), Choice(Outcome.ADDED, GRAVITY, (), "")

    def found(end: CandidateModel, promise: float, gain: float | None = None) -> CandidateModel | None:
        trial = judge_trial(GRAVITY, before, end.trying((GRAVITY,), {"T_g": 0.0}))
        gain = trial.verdict.gain if gain is None else gain
        assert gain > 0.0
        trial = replace(trial, verdict=replace(trial.verdict, gain=gain))
        screened = (signature(GRAVITY, promise * gain),)
        return deeper_optimum(Round(shallow, before, screened, (trial,), choice), quiet)

    anew = found(deep, 0.4)
    assert anew is not None
    assert anew.added == ()
    assert anew.chi2 < shallow.chi2
    assert found(shallow, 0.4, gain=50.0) is None, "the gain is the effect's own"
    assert found(deep, 0.6) is None, "the effect explains what it promised"


def test_no_round_is_made_beyond_those_that_the_settings_allow(small: CandidateModel, rig: Rig) -> None:
    result = results.result(rig)
    made = rounds(result)
    s = replace(small, settings=replace(small.settings, rounds=len(made)))
    progress = Progress(s, rounds=made)
    after = forward(result, progress, refuse)
    assert (after.model, after.rounds, after.found) == (s, made, ())
    assert after.is_at_an_end  # the last of them adds nothing
    assert not Progress(s).is_at_an_end
    assert not Progress(s, rounds=made[:1]).is_at_an_end


def test_going_back_to_the_first_model_keeps_what_was_learnt(small: CandidateModel) -> None:
    more = small.with_effects((GRAVITY,), {"T_g": 0.1})
    progress = Progress(more, changed=("One gave way.",))
    back = progress.back_to(small, "All was taken away.")
    assert back.model is small
    assert back.changed == ("One gave way.", "All was taken away.")


def test_the_first_fit_is_the_final_one_where_nothing_was_added(small: CandidateModel, rig: Rig) -> None:
    result = results.result(rig)
    assert final_fit(result, Progress(small), quiet) is result


# ---- Which effects a fit is made anew with; that it finds one is tested on a whole folder: test_recovery_of_the_hidden

LAG, BACKLASH = (EFFECT_BY_NAME[n] for n in ("position_sensor_lag", "backlash"))
NOTHING_PROMISES = Choice(Outcome.NO_PROMISE, None, (), "")
AT = {"T_g": 0.1}


def test_only_a_sensor_that_follows_late_is_hidden() -> None:
    """One that bends shows at rest too, and a delay of the current moves no angle."""
    assert [effect.name for effect in EFFECTS if effect.hidden] == ["position_sensor_lag"]


def test_a_fit_is_made_anew_with_hidden_effects_alone() -> None:
    assert maskable((BACKLASH, LAG, GRAVITY)) == (LAG,)
    assert maskable((BACKLASH, GRAVITY)) == ()


def test_where_none_is_hidden_no_fit_is_made_and_nothing_is_added(small: CandidateModel, rig: Rig) -> None:
    assert maskable(small.composition.candidates) == ()
    turned = Round(small, score(1.0), (), (), NOTHING_PROMISES)
    assert find_masked_effect(result(rig), turned, lambda text, share: pytest.fail(text)) is None


def test_a_hidden_effect_is_sought_beside_none_and_beside_the_first_found(
    small: CandidateModel, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Effects of the rig only beside none, because they are screened in the free run of the first fit."""
    room, tried = "etcfit.diagnosis.rounds", list[tuple[tuple[str, ...], str]]()
    monkeypatch.setattr(f"{room}.maskable", lambda _: (LAG,))
    monkeypatch.setattr(f"{room}._of_the_rig", lambda *_: (BACKLASH,))
    far, second = (replace(s, end=Termination(True, "", far=True)) for s in (small, small.with_effects((GRAVITY,), AT)))

    def refused(effect: Effect, _: FitResult, before: CandidateModel, *__: object) -> None:
        tried.append((tuple(e.name for e in before.added), effect.name))

    monkeypatch.setattr(f"{room}.fitted_with", refused)
    monkeypatch.setattr(f"{room}.run_round", lambda s, _: Round(s, score(1.0), (), (), NOTHING_PROMISES))
    monkeypatch.setattr(f"{room}.refit_chosen", lambda turned, _: (turned, turned.before))
    for made, s in enumerate((far, second, second)):
        turned, new = round_and_model(result(rig), s, quiet, made)
        assert (turned.before, new) == (s, s)
    assert tried == [((), LAG.name), ((), BACKLASH.name), ((GRAVITY.name,), LAG.name)]


@pytest.mark.parametrize(
    ("left", "white", "asked", "chosen"),
    [
        ((1.7, 0.98, 3.0), (False, True, False), 2, 1),  # a gear after a gain that only resembles it
        ((0.98, 0.5), (True, True), 1, 0),
        ((1.7, 1.2, 1.4), (False, False, False), 3, 1),
    ],
)
def test_the_one_that_leaves_noise_is_taken_or_else_the_one_that_leaves_least(
    left: tuple[float, ...], white: tuple[bool, ...], asked: int, chosen: int, small: CandidateModel
) -> None:
    effects = (LAG, BACKLASH, GRAVITY)
    every = [Near(*each) for each in zip(effects, [small] * len(left), left, white, strict=False)]
    given: list[Near] = []

    def one_by_one() -> Iterator[Near]:
        for each in every:
            given.append(each)
            yield each

    found = nearest(one_by_one())
    assert found is every[chosen]
    assert len(given) == asked


def test_of_none_none_is_taken() -> None:
    assert nearest([]) is None


# ---- One turn of the loop on a real model: what it looks at, tries and chooses


def made(s: CandidateModel, effect: type | None) -> Round:
    choice = Choice(Outcome.ADDED if effect else Outcome.NOT_WORTH_IT, effect, (), "Because.")
    trials = (Trial(s, verdict(LIMP, -500.0)), Trial(s, verdict(GRAVITY, -400.0)))
    return Round(s, score(1000.0), (), trials, choice)


def test_the_best_trial_is_that_of_the_effect_added_though_another_has_the_lower_bic(model: CandidateModel) -> None:
    assert made(model, GRAVITY).best.verdict.effect is GRAVITY
    with pytest.raises(LookupError, match="no effect was added"):
        _ = made(model, None).best


def test_a_round_that_adds_nothing_leaves_the_model_that_it_began_with(model: CandidateModel) -> None:
    turned = made(model, None)
    assert refit_chosen(turned, quiet) == (turned, model)


@pytest.mark.slow
def test_a_turn_screens_its_candidates_and_says_what_it_tried(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its only trace was drawn by hand, so the only candidate promises something."""
    said: list[str] = []
    monkeypatch.setattr("etcfit.diagnosis.choice.LEAST_PROMISE", 0.0)
    s = small.optimised()
    turned = run_round(s, lambda text, share: said.append(text))
    assert said[:2] == ["screening 1 effects", "refitting with gravity_load"]
    assert [g.variant.effect for g in turned.screened] == [GRAVITY]
    (trial,) = turned.trials
    assert trial.verdict.gain > 0.0
    assert trial.verdict.gain == pytest.approx(turned.score.chi2 - trial.model.chi2)
    assert turned.choice == choose([trial.verdict], s.settings, s.weighted.samples)
    assert turned.choice.outcome in (Outcome.ADDED, Outcome.NOT_WORTH_IT, Outcome.CONTRADICTED, Outcome.SMALL_PART)


def test_an_effect_at_work_is_no_candidate(small: CandidateModel) -> None:
    turned = run_round(replace(small.with_effects((GRAVITY,), {"T_g": 0.01}), holdout=None), quiet)
    assert turned.screened == ()
    assert turned.choice.outcome is Outcome.NO_PROMISE


def test_a_refit_starts_from_the_best_few_variants_of_an_effect() -> None:
    """At most four, and none that promises less than three tenths of the best."""
    backlash, other = EFFECT_BY_NAME["backlash"], EFFECT_BY_NAME["cogging_torque"]
    some = iter(variants(backlash))
    every = [Signature(next(some), np.zeros((0, 1)), gain, {}, 1.0) for gain in (10.0, 100.0, 31.0, 29.0, 80.0)]
    every.append(Signature(variants(other)[0], np.zeros((0, 1)), 99.0, {}, 1.0))
    assert [g.gain for g in starts_of(every[1], every)] == [100.0, 80.0, 31.0]
    many = [replace(each, gain=100.0 - n) for n, each in enumerate(every[:5])]
    assert [g.gain for g in starts_of(many[0], many)] == [100.0, 99.0, 98.0, 97.0]
