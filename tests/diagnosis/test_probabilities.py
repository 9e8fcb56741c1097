"""Probabilities from numbers made by hand: what the evidence says, and what no evidence can."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from etcfit.diagnosis.findings import Candidate, Evidence, RoundReport
from etcfit.diagnosis.probabilities import (
    BETWEEN_SAMPLES,
    NOTHING,
    SOMETHING_ELSE,
    UNEXPLAINED,
    questions,
)
from etcfit.diagnosis.probabilities import probabilities as of_questions
from etcfit.diagnosis.settings import DEFAULT, DiagnosisSettings

WHITE, COLOURED = (Evidence((), white, (), ()) for white in (True, False))
LAPSE, MISSED, T = DEFAULT.lapse, DEFAULT.missed, DEFAULT.bic_temper


def probabilities(
    rounds: Sequence[RoundReport], added: Sequence[str], curve: bool, settings: DiagnosisSettings, slow: bool = False
) -> Mapping[str, float]:
    asked = questions(rounds, added, curve, settings, slow)
    return of_questions(asked, rounds, added, curve, settings)


def turn(added: str | None, ties: tuple[str, ...] = (), **changes: float) -> RoundReport:
    candidates = tuple(Candidate(name, 1.0, 1.0, True, 0.9, 0.9, 0.0, change) for name, change in changes.items())
    asleep = Candidate("never_refitted", 1.0, 1.0, False)
    return RoundReport((), WHITE, 1.0, 1.0, (*candidates, asleep), added, ties, "")


def test_strong_evidence_is_as_sure_as_the_lapse_allows() -> None:
    p = probabilities([turn("a", a=-5000.0, b=-100.0), turn(None, b=20.0)], ["a"], False, DEFAULT)
    assert p["a"] == pytest.approx(1.0 - LAPSE, abs=1e-6)
    assert p["b"] < MISSED
    assert p[NOTHING] < 0.02
    assert p[UNEXPLAINED] == LAPSE
    assert "never_refitted" not in p


def test_effects_that_do_as_well_share_the_probability() -> None:
    p = probabilities([turn("a", ("b",), a=-1000.0, b=-1000.0)], ["a"], False, DEFAULT)
    assert p["a"] == pytest.approx(p["b"])
    assert p["a"] + p["b"] == pytest.approx(1.0 - LAPSE, abs=1e-6)
    less = probabilities([turn("a", ("b",), a=-1000.0, b=-1000.0 + 2.0 * T)], ["a"], False, DEFAULT)
    assert less["b"] == pytest.approx(less["a"] / math.e)


def test_weak_evidence_leaves_room_for_nothing() -> None:
    weak, strong = (probabilities([turn("a", a=-b)], ["a"], False, DEFAULT) for b in (2.0 * T, 20.0 * T))
    assert 0.5 < weak["a"] < strong["a"]
    assert weak["a"] == pytest.approx((1.0 - LAPSE) / (1.0 + math.exp(-1.0)))
    assert weak[NOTHING] > strong[NOTHING]


def test_one_contradicted_by_what_was_held_out_has_no_share_though_its_bic_is_lower() -> None:
    p = probabilities([turn("a", a=-1000.0, b=-3000.0)], ["a"], False, DEFAULT)
    assert p["a"] > 0.8 * (1.0 - LAPSE)
    assert p["b"] == 0.0


def test_what_was_taken_in_untried_and_taken_away_again_is_as_likely_as_what_was_missed() -> None:
    """The second of a pair that a held-out trace refuted later: no round ever gave it a BIC of its own."""
    p = probabilities([turn("a", a=-100.0), turn("b"), turn(None, c=5.0)], ["a"], False, DEFAULT)
    assert p["b"] == MISSED


def test_a_clean_folder_is_called_so() -> None:
    p = probabilities([turn(None, a=15.0, b=30.0)], [], False, DEFAULT)
    assert p[NOTHING] == 1.0 - MISSED
    assert p["a"] < MISSED
    weight = {effect: math.exp(-0.5 * change / T) for effect, change in (("a", 15.0), ("b", 30.0))}
    for effect, w in weight.items():
        assert p[effect] == pytest.approx(MISSED * w / (sum(weight.values()) + 1.0))
    assert p[UNEXPLAINED] == MISSED


def test_a_curve_without_a_name_is_unexplained() -> None:
    p = probabilities([turn(None, a=-15.0)], [], True, DEFAULT)
    assert p[UNEXPLAINED] == 1.0 - LAPSE
    assert p[NOTHING] < 0.2


def test_an_effect_taken_away_again_is_not_believed() -> None:
    kept, gone = (probabilities([turn("a", a=-900.0)], added, False, DEFAULT) for added in (["a"], []))
    assert kept["a"] > 0.8
    assert gone["a"] == pytest.approx(MISSED)


def test_two_rounds_are_two_reasons() -> None:
    first, second = turn("b", ("a",), a=-50.0, b=-60.0), turn("a", a=-3.0 * T)
    once, again = (probabilities([each], ["b", "a"], False, DEFAULT)["a"] for each in (first, second))
    twice = probabilities([first, second], ["b", "a"], False, DEFAULT)
    assert 0.01 < once < again < 0.9
    assert twice["a"] == pytest.approx(1.0 - (1.0 - once) * (1.0 - again))


def test_where_more_than_noise_is_left_it_is_not_said_that_nothing_is_missing() -> None:
    far = replace(turn(None, a=-9000.0), evidence=COLOURED)  # contradicted by what was held out, and a large residual
    p = probabilities([far], [], False, DEFAULT)
    assert p[NOTHING] <= LAPSE
    assert p[UNEXPLAINED] == 1.0 - LAPSE


@pytest.mark.parametrize("added", [["a"], [], ["a", "b"]])
def test_answers_to_one_question_add_up_to_one(added: list[str]) -> None:
    rounds = [turn("a", ("b",), a=-50.0, b=-49.0, c=3.0), turn("b", b=-9.0), turn(None, c=5.0, d=-200.0)]
    asked = questions(rounds, added, False, DEFAULT)
    assert len(asked) == len(rounds) + 1
    for question in asked:
        assert sum(question.answers.values()) == pytest.approx(1.0, abs=1e-12), question.asks
        assert min(question.answers.values()) >= 0.0
    first = asked[0].answers
    assert first[SOMETHING_ELSE] >= LAPSE - 1e-12
    assert (first["a"] > MISSED) == ("a" in added), "what was taken away again leaves its share to something else"


def test_beside_a_slow_log_no_name_is_surer_than_may_be() -> None:
    rounds = [turn("a", a=-9000.0), turn(None, c=5.0)]
    asked = questions(rounds, ["a"], False, DEFAULT, slow=True)
    assert all(sum(each.answers.values()) == pytest.approx(1.0) for each in asked)
    p = probabilities(rounds, ["a"], False, DEFAULT, slow=True)
    assert p["a"] == pytest.approx((1.0 - DEFAULT.slow_log) * (1.0 - LAPSE))
    assert BETWEEN_SAMPLES not in p


def test_no_more_than_inexact_formulas_leave_is_nothing_without_a_name() -> None:
    unread = replace(turn(None), candidates=(), evidence=COLOURED)
    assert probabilities([turn("a", a=-9000.0), unread], ["a"], False, DEFAULT)[UNEXPLAINED] == LAPSE
