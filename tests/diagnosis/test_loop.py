"""One turn of the loop on a real model: what it looks at, tries and chooses."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnoses import score, verdict
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import Choice, Outcome, choose
from etcfit.diagnosis.loop import Round, refit_chosen, run_round
from etcfit.diagnosis.trial import Trial
from etcfit.estimation.joint_fit import quiet
from etcfit.model.effects import EFFECT_BY_NAME

GRAVITY, LIMP = (EFFECT_BY_NAME[n] for n in ("gravity_load", "limp_home_spring"))


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
def test_a_turn_screens_its_candidates_and_says_what_it_tried(small: CandidateModel) -> None:
    """Its only trace was drawn by hand, so the only candidate promises something."""
    said: list[str] = []
    s = replace(small.optimised(), settings=replace(small.settings, least_promise=0.0))
    turned = run_round(s, lambda text, share: said.append(text))
    assert said[:2] == ["screening 1 effects", "refitting with gravity_load"]
    assert [g.variant.effect for g in turned.screened] == [GRAVITY]
    (trial,) = turned.trials
    assert trial.verdict.gain > 0.0
    assert trial.verdict.gain == pytest.approx(turned.score.chi2 - trial.model.chi2)
    assert turned.choice == choose([trial.verdict], s.settings, turned.score.chi2, s.weighted.samples)
    assert turned.choice.outcome in (Outcome.ADDED, Outcome.NOT_WORTH_IT, Outcome.CONTRADICTED, Outcome.SMALL_PART)


def test_a_turn_within_what_formulas_leave_screens_nothing(small: CandidateModel) -> None:
    """Screening is what it costs to look."""
    said: list[str] = []
    s = small.with_effects((GRAVITY,), {"T_g": 0.01})
    turned = run_round(s, lambda text, share: said.append(text), 1e12)
    assert said == []
    assert (turned.screened, turned.trials, turned.added) == ((), (), None)
    assert turned.choice.outcome is Outcome.NOTHING_TO_READ
    assert "a formula of gravity_load that is 2 % off" in turned.choice.why


def test_an_effect_at_work_is_no_candidate(small: CandidateModel) -> None:
    turned = run_round(replace(small.with_effects((GRAVITY,), {"T_g": 0.01}), holdout=None), quiet)
    assert turned.screened == ()
    assert turned.choice.outcome is Outcome.NO_PROMISE
