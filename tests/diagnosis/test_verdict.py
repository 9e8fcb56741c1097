"""The last word of a diagnosis: is the final model kept, and what is said."""

from __future__ import annotations

from dataclasses import replace

import pytest

import diagnoses
import results
from diagnoses import error
from etcfit.diagnosis.composition import Effect
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.findings import RigMistake, Statement
from etcfit.diagnosis.score import Apart
from etcfit.diagnosis.settings import DEFAULT, DiagnosisSettings
from etcfit.diagnosis.statements import Named, certainty, runs_free_worse, statement, tie, verdict
from etcfit.estimation.result import FitResult
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.rig.base import Rig

LIMP, AIR = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "airflow_torque"))


def fitted(rig: Rig, rms: float, held_out: float | None) -> FitResult:
    """A fit whose free-run errors are so many sigma."""
    return results.result(rig, score_fit=(error(rms),), score_holdout=() if held_out is None else (error(held_out),))


@pytest.mark.parametrize(
    ("after", "before", "worse"),
    [
        ((1.0, 2.5), (9.0, 2.0), True),  # what was held out decides
        ((9.0, 2.3), (1.0, 2.0), False),  # worse by 15 %: a slip may fall elsewhere
        ((2.5, None), (2.0, None), True),
        ((1.9, None), (2.0, None), False),
        ((1.0, float("nan")), (9.0, 2.0), True),  # it diverged
    ],
)
def test_a_model_that_strays_from_what_was_held_out_is_not_kept(
    rig: Rig, after: tuple, before: tuple, worse: bool
) -> None:
    end, beginning = fitted(rig, *after), fitted(rig, *before)
    assert runs_free_worse(end, beginning, DiagnosisSettings()) is worse
    assert not runs_free_worse(replace(end, score_holdout=(), score_fit=(error(1.0),)), fitted(rig, 1.0, None),
                               DiagnosisSettings())  # fmt: skip


# ---- in words


def test_ties_name_the_one_in_the_model_first_and_what_would_separate_them() -> None:
    made = tie(Found(LIMP, {AIR: Apart(0.03, {})}, 100.0, {}))
    assert made.effects == (LIMP.name, AIR.name)
    assert made.apart == (0.03,)
    assert made.told_by == f"{LIMP.name}: {LIMP.told_by}; {AIR.name}: {AIR.told_by}"


def stated(effect: Effect, probability: float = 0.9, **answers: float) -> Statement:
    return statement(effect, Named(effect.name), probability, answers, DEFAULT)


def test_effects_found_ties_and_the_last_reason_are_said(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    made = tie(Found(LIMP, {AIR: Apart(0.03, {})}, 100.0, {}))
    assert verdict((stated(LIMP),), (made,), None, (first, replace(last, candidates=()))) == (
        "Found: the model lacked limp_home_spring (0.90).",
        "limp_home_spring and airflow_torque cannot be told apart by these data: their fits differ by at most 0.03 "
        "times the noise.",
        "cogging_torque is not worth its parameters.",
    )


@pytest.mark.parametrize(
    ("probability", "word", "acted_on"),
    [(0.9 - 1e-12, "found", True), (0.894, "probably", True), (0.8, "probably", True), (0.794, "probably", False),
     (0.7, "probably", False), (0.694, "may be", False)],
)  # fmt: skip
def test_a_name_is_as_sure_as_the_two_digits_that_are_shown(probability: float, word: str, acted_on: bool) -> None:
    made = stated(LIMP, probability)
    assert made.certainty == certainty(probability) == word
    assert made.acted_on is acted_on
    assert f"({probability:.2f})" in made.sentence


def test_a_name_that_is_not_sure_says_what_else_could_be_and_what_would_tell() -> None:
    made = stated(AIR, 0.55, airflow_torque=0.55, limp_home_spring=0.2, nothing=0.24, backlash=0.01)
    assert made.instead == {"nothing": 0.24, "limp_home_spring": 0.2}
    assert made.sentence == (
        "The model may lack airflow_torque (0.55). What else could be: nothing 0.24, limp_home_spring 0.20. "
        f"What would tell: {AIR.told_by}."
    )
    assert "tell" not in stated(AIR, 0.9, limp_home_spring=0.05).sentence


def test_a_mistake_of_the_rig_is_said_before_what_the_model_lacks(rig: Rig) -> None:
    sag = EFFECT_BY_NAME["airflow_torque"]
    mistake = RigMistake(sag.name, "kind", None, None, 1.0, "", "[rig]", "")
    said = verdict((stated(LIMP), stated(sag)), (), None, diagnoses.rounds(results.result(rig)), (mistake,))
    assert [sentence.split()[4] for sentence in said[:2]] == ["airflow_torque", "limp_home_spring"]


def test_what_is_left_is_said_as_a_curve_or_as_unexplained(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    curve = diagnoses.unexplained(results.result(rig))
    lacked = stated(LIMP)
    assert verdict((lacked,), (), curve, (first, last)) == (lacked.sentence, curve.sentence)
    assert verdict((lacked,), (), None, (first, last)) == (lacked.sentence,)  # the last residual is white
    odd = replace(last, evidence=first.evidence)
    assert verdict((lacked,), (), None, (first, odd))[1].startswith("The residual is not all noise, but nothing")


def test_where_nothing_is_added_it_is_said_whether_anything_is_lacking(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    assert verdict((), (), None, (last,)) == ("The residual is noise: the model lacks nothing that these data show.",)
    assert verdict((), (), None, (replace(first, added=None),))[0] == (
        "No effect of the catalogue is proven by these data."
    )
