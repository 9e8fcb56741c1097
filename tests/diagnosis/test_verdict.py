"""The last word of a diagnosis: is the final model kept, and what is said."""

from __future__ import annotations

from dataclasses import replace

import pytest

import diagnoses
import results
from diagnoses import error
from etcfit.diagnosis.ambiguity import Apart
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.verdict import runs_free_worse, tie, verdict
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


def test_effects_found_ties_and_the_last_reason_are_said(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    made = tie(Found(LIMP, {AIR: Apart(0.03, {})}, 100.0, {}))
    assert verdict((LIMP,), (made,), None, (first, replace(last, candidates=()))) == (
        "The model lacked limp_home_spring.",
        "limp_home_spring and airflow_torque cannot be told apart by these data: their fits differ by at most 0.03 "
        "times the noise.",
        "cogging_torque is not worth its parameters.",
    )


def test_a_name_below_the_limit_is_a_suspicion_with_what_would_tell(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    said = verdict((LIMP, AIR), (), None, (first, last), (), {LIMP.name: 0.9, AIR.name: 0.55})
    assert said == (
        "The model lacked limp_home_spring.",
        "The model may lack airflow_torque. This is a suspicion, with probability 0.55. "
        f"What would tell: {AIR.told_by}.",
    )
    likely = DiagnosisSettings(suspicion=0.5)
    assert verdict((LIMP, AIR), (), None, (first, last), (), {LIMP.name: 0.9, AIR.name: 0.55}, likely) == (
        "The model lacked limp_home_spring and airflow_torque.",
    )


def test_what_is_left_is_said_as_a_curve_or_as_unexplained(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    curve = diagnoses.unexplained(results.result(rig))
    lacked = "The model lacked limp_home_spring."
    assert verdict((LIMP,), (), curve, (first, last)) == (lacked, curve.sentence)
    assert verdict((LIMP,), (), None, (first, last)) == (lacked,)  # the last residual is white
    odd = replace(last, evidence=first.evidence)
    assert verdict((LIMP,), (), None, (first, odd))[1].startswith("The residual is not all noise, but nothing")


def test_where_nothing_is_added_it_is_said_whether_anything_is_lacking(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    assert verdict((), (), None, (last,)) == ("The residual is noise: the model lacks nothing that these data show.",)
    assert verdict((), (), None, (replace(first, added=None),))[0] == (
        "No effect of the catalogue is proven by these data."
    )
