"""Probabilities from numbers made by hand: what the evidence says, and what no evidence can."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from etcfit.diagnosis.credit import (
    credit_by_round,
    doubted_effects,
    held_out_share,
    largest_probability,
    left_share,
)
from etcfit.diagnosis.findings import Candidate, Evidence, RoundReport, Whiteness
from etcfit.diagnosis.probabilities import (
    BETWEEN_SAMPLES,
    BIC_TEMPER,
    NOTHING,
    SOMETHING_ELSE,
    UNEXPLAINED,
    WORTH_NAMING,
    named_effects,
    questions,
)
from etcfit.diagnosis.probabilities import probabilities as of_questions
from etcfit.diagnosis.settings import DEFAULT, DiagnosisSettings

WHITE, COLOURED = (Evidence((), white, (), ()) for white in (True, False))
LAPSE, MISSED, T = DEFAULT.lapse, DEFAULT.missed, BIC_TEMPER


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


def test_where_all_effects_were_taken_away_again_the_misfit_of_the_first_model_is_unexplained() -> None:
    """The last round saw noise beside an effect that is no longer in the model."""
    p = probabilities([replace(turn("a", a=-900.0), evidence=COLOURED), turn(None)], [], False, DEFAULT)
    assert p[UNEXPLAINED] == 1.0 - LAPSE
    assert p[NOTHING] <= LAPSE


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


# ---- What a name may be believed, from what it explains where it acts and what is left there

N = 1000
VOLTS_1, VOLTS_2, DRIVE = "viscous/volts_1.csv", "viscous/volts_2.csv", "response/drive_1.csv"
WARM, GAIN, CLOCK = f"warm_start[{VOLTS_2}]", f"channel_gain[{VOLTS_2}.voltage]", "time_scale[viscous]"
FRICTION, SPRING, DRAG, RATIO = "presliding_friction", "limp_home_spring", "quadratic_drag", "gear_ratio"


def excess_round(added: str | None, excess: Mapping[str, float]) -> RoundReport:
    """A round that begins with so much chi2 above one a sample in each trace of N samples; noise where it is 0."""
    rows = tuple(
        Whiteness(file, file.partition("/")[0], "current", N, math.sqrt(1.0 + e), 1.0, "time", 0.0, 1.0, e == 0.0)
        for file, e in excess.items()
    )
    candidates = () if added is None else (Candidate(added, 1.0, 1.0, True, 0.9, 0.9, 0.0, -9000.0),)
    return RoundReport((), Evidence(rows, not any(excess.values()), (), ()), 1.0, 1.0, candidates, added, (), "")


def of(*rounds: RoundReport) -> list[float]:
    return credit_by_round(rounds, [each.added for each in rounds if each.added is not None])


@pytest.mark.parametrize(("left", "named"), [(0.0, (DRAG,)), (3.0, ())])
def test_beside_a_slow_log_an_effect_is_named_only_if_the_model_leaves_noise(left: float, named: tuple) -> None:
    rounds = [excess_round(DRAG, {DRIVE: 900.0}), excess_round(None, {DRIVE: left})]
    for slow in (True, False):
        found = named_effects(rounds, [DRAG], (), False, DEFAULT, slow)
        assert found.names == (named if slow else (DRAG,))
        assert found.doubts == tuple(name for name in (DRAG,) if name not in found.names)


def test_one_name_that_leaves_noise_is_believed() -> None:
    assert of(excess_round(WARM, {VOLTS_2: 4.0, DRIVE: 0.0}), excess_round(None, {VOLTS_2: 0.0, DRIVE: 0.0})) == [
        1.0,
        1.0,
    ]


def test_a_name_that_leaves_more_than_it_explains_is_not() -> None:
    """A torque ripple that no effect has: three names explain a fifth of it."""
    said = of(excess_round(DRAG, {DRIVE: 6.0}), excess_round(SPRING, {DRIVE: 5.5}), excess_round(None, {DRIVE: 4.8}))
    assert said[0] == pytest.approx(0.5 / (0.5 + 4.8), abs=1e-3)
    assert max(said[:2]) < 0.2


def test_a_mistake_in_one_trace_answers_for_that_trace_and_no_other() -> None:
    elsewhere = of(excess_round(WARM, {VOLTS_2: 4.0, DRIVE: 9.0}), excess_round(None, {VOLTS_2: 0.0, DRIVE: 9.0}))
    assert elsewhere[0] == 1.0
    here = of(excess_round(WARM, {VOLTS_2: 4.0, DRIVE: 9.0}), excess_round(None, {VOLTS_2: 3.0, DRIVE: 0.0}))
    assert here[0] == pytest.approx(0.25)


def test_two_mistakes_in_one_test_are_likelier_one_thing_without_a_name() -> None:
    """A faint current limit: a warm winding, a gain and a clock of one test were each stated with 0.90."""
    said = of(
        excess_round(WARM, {VOLTS_2: 1.0}),
        excess_round(GAIN, {VOLTS_2: 0.5}),
        excess_round(CLOCK, {VOLTS_2: 0.2}),
        excess_round(None, {VOLTS_2: 0.0}),
    )
    assert said[:3] == pytest.approx([0.5, 0.3, 0.2])


def test_mistakes_in_two_tests_are_two() -> None:
    gain = "channel_gain[response.current]"
    said = of(
        excess_round(WARM, {VOLTS_2: 4.0, DRIVE: 4.0}),
        excess_round(gain, {VOLTS_2: 0.0, DRIVE: 4.0}),
        excess_round(None, {VOLTS_2: 0.0, DRIVE: 0.0}),
    )
    assert said == [1.0, 1.0, 1.0]


def test_a_second_effect_that_leaves_noise_is_believed_however_much_the_first_explained() -> None:
    """What inexact formulas may leave is no part of these rows."""
    said = of(
        excess_round(FRICTION, {DRIVE: 150.0}), excess_round(SPRING, {DRIVE: 1.0}), excess_round(None, {DRIVE: 0.0})
    )
    assert said == [1.0, 1.0, 1.0]


def test_what_did_not_stay_or_was_never_seen_without_is_not_judged() -> None:
    rounds = (excess_round(DRAG, {DRIVE: 6.0}), excess_round(SPRING, {DRIVE: 5.5}))
    assert credit_by_round(rounds, [SPRING]) == [1.0, 1.0]


# ---- what is stated


def stated(*rounds: RoundReport) -> Mapping[str, float]:
    every = [each.added for each in rounds if each.added is not None]
    found = named_effects(rounds, every, doubted_effects(rounds, every), False, DEFAULT, slow=False)
    assert all(sum(each.answers.values()) == pytest.approx(1.0) for each in found.questions)
    return found.probabilities


def test_a_name_that_is_hardly_likely_is_not_said() -> None:
    """It came in the place of another, and no round ever found it likely."""
    rival = Candidate(SPRING, 1.0, 1.0, True, 0.9, 0.9, 0.0, 50.0)
    first = excess_round(DRAG, {DRIVE: 4.0})
    rounds = (replace(first, candidates=(*first.candidates, rival)), excess_round(None, {DRIVE: 0.0}))
    found = named_effects(rounds, [DRAG, SPRING], [], False, DEFAULT, slow=False)
    assert (found.names, found.doubts) == ((DRAG,), (SPRING,))
    assert found.probabilities[SPRING] < WORTH_NAMING


def test_a_name_in_a_tie_is_as_likely_as_all_of_the_tie() -> None:
    """Three alike share what is known: none of them is likely by itself, one of them is there."""
    alike = [Candidate(name, 1.0, 1.0, True, 0.9, 0.9, 0.0, -50.0) for name in (DRAG, SPRING, "a", "b", "c", "d")]
    first = replace(excess_round(DRAG, {DRIVE: 4.0}), candidates=tuple(alike))
    rounds = (replace(first, ties=(SPRING, "a", "b", "c", "d")), excess_round(None, {DRIVE: 0.0}))
    found = named_effects(rounds, [DRAG], [], False, DEFAULT, slow=False)
    assert found.probabilities[DRAG] < WORTH_NAMING
    assert found.names == (DRAG,)


def test_names_that_something_else_outdoes_are_in_doubt_and_what_they_explain_has_no_name() -> None:
    """All noise at the end, and yet nothing was found: four mistakes of one test."""
    rounds = (
        excess_round(WARM, {VOLTS_2: 1.0}),
        excess_round(GAIN, {VOLTS_2: 0.7}),
        excess_round(CLOCK, {VOLTS_2: 0.4}),
        excess_round(None, {VOLTS_2: 0.0}),
    )
    assert doubted_effects(rounds, [WARM, GAIN, CLOCK]) == [WARM, GAIN, CLOCK]
    assert left_share(rounds, [WARM, CLOCK]) == pytest.approx(0.7)
    p = stated(*rounds)
    assert max(p[WARM], p[GAIN], p[CLOCK]) <= DEFAULT.missed
    assert p[UNEXPLAINED] == pytest.approx(1.0 - DEFAULT.lapse)
    assert p[NOTHING] < 0.1


def test_a_name_is_stated_with_no_more_than_its_credit() -> None:
    p = stated(excess_round(DRAG, {DRIVE: 4.0}), excess_round(None, {DRIVE: 1.0}))
    assert p[DRAG] == pytest.approx(0.75)
    sure = stated(excess_round(WARM, {VOLTS_2: 4.0}), excess_round(None, {VOLTS_2: 0.0}))
    assert sure[WARM] == pytest.approx(1.0 - DEFAULT.lapse)


def test_a_mistake_of_the_rig_that_leaves_more_than_noise_is_not_named() -> None:
    """A current limit was called a zero of one channel with 0.90: all other mistakes left noise. Something without a
    name is likelier there."""
    warm = excess_round(WARM, {VOLTS_2: 400.0})
    assert largest_probability(WARM, (warm, excess_round(None, {VOLTS_2: 0.3})), False, DEFAULT) == 0.3
    for left, curve, names in ((0.3, False, ()), (0.04, False, (WARM,)), (0.0, False, (WARM,)), (0.0, True, ())):
        rounds = (warm, excess_round(None, {VOLTS_2: left}))
        found = named_effects(rounds, [WARM], [], curve, DEFAULT, slow=False)
        assert found.names == names
        unnamed = DEFAULT.lapse if names else 1.0 - DEFAULT.lapse
        assert found.probabilities[UNEXPLAINED] == pytest.approx(unnamed)


def test_a_curve_that_corrects_a_formula_is_no_effect_without_a_name() -> None:
    """It still shows that more than a mistake of the rig is at work, which leaves noise."""
    rounds = (excess_round(DRAG, {DRIVE: 400.0}), excess_round(None, {DRIVE: 0.0}))
    for corrected, unnamed in (((), 1.0 - DEFAULT.lapse), ((DRAG,), DEFAULT.lapse)):
        found = named_effects(rounds, [DRAG], [], True, DEFAULT, slow=False, corrected=corrected)
        assert found.probabilities[UNEXPLAINED] == pytest.approx(unnamed)
    of_the_rig = (excess_round(WARM, {VOLTS_2: 400.0}), excess_round(None, {VOLTS_2: 0.0}))
    imitated = named_effects(of_the_rig, [WARM], [], True, DEFAULT, slow=False, corrected=(DRAG,))
    assert imitated.probabilities[WARM] == pytest.approx(0.3)


def test_what_an_inexact_formula_leaves_is_no_other_cause_of_what_an_effect_explains() -> None:
    """Friction beside bristles: the curve of the rest corrects the bristles. A mistake of the rig leaves noise."""
    for name, credit in ((DRAG, (0.2, 1.0)), (WARM, (0.2, 0.2)), (RATIO, (0.2, 0.2))):
        rounds = (excess_round(name, {VOLTS_2: 5.0}), excess_round(None, {VOLTS_2: 4.0}))
        assert [credit_by_round(rounds, [name], corrected)[0] for corrected in ((), (SPRING,))] == pytest.approx(credit)
        assert doubted_effects(rounds, [name], (SPRING,)) == ([] if name == DRAG else [name])


def test_what_a_formula_may_not_leave_is_another_cause() -> None:
    """Friction that is 10 % off took up all that a coasting bridge and a limp-home spring did to a real throttle."""
    first, noise = excess_round(FRICTION, {DRIVE: 10.0}), excess_round(None, {DRIVE: 0.0})
    for taken_up, other in ((0.02, 0.0), (2.0, 1.96)):
        rounds = (first, replace(noise, chi2_per_sample=1.0 + taken_up))
        for corrected in ((), (FRICTION,)):
            assert credit_by_round(rounds, [FRICTION], corrected)[0] == pytest.approx(10.0 / (10.0 + other))
        assert left_share(rounds) == pytest.approx(other / 10.0)


def test_no_name_is_sure_where_the_last_model_leaves_three_times_the_noise() -> None:
    first, last = excess_round(FRICTION, {DRIVE: 2000.0}), excess_round(None, {DRIVE: 0.0})
    for left, most in ((1.2, 1.0 - DEFAULT.lapse), (3.5, 0.7), (None, 1.0 - DEFAULT.lapse)):
        rounds = (first, replace(last, chi2_per_sample=left))
        assert largest_probability(FRICTION, rounds, False, DEFAULT) == most
    exhausted = (first, replace(excess_round(DRAG, {DRIVE: 2.5}), chi2_per_sample=3.5))
    assert largest_probability(FRICTION, exhausted, False, DEFAULT) == 1.0 - DEFAULT.lapse, (
        "the last model has the drag"
    )


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [(3.0, 2.2, 1.0), (10.0, 2.2, 1.0), (10.0, 10.0, 1.0 / 96.0), (10.0, 20.0, 1.0 / 396.0), (11.0, 5.0, 97.0 / 117.0),
     (None, None, 1.0)],
    ids=["noise", "to noise", "as far", "further", "most of it", "nothing held out"],
)  # fmt: skip
def test_what_strays_as_before_on_held_out_traces_has_no_sure_name(
    before: float | None, after: float | None, share: float
) -> None:
    """Friction that drifts was called dependent on the load with 0.88."""
    first = replace(excess_round(DRAG, {DRIVE: 400.0}), holdout_rms=before)
    rounds = (first, replace(excess_round(None, {DRIVE: 0.0}), holdout_rms=after))
    assert held_out_share(rounds) == pytest.approx(share)
    assert largest_probability(DRAG, rounds, False, DEFAULT) == pytest.approx(min(share, 0.9))
    found = named_effects(rounds, [DRAG], [], False, DEFAULT, slow=False)
    assert found.names == ((DRAG,) if share > 0.5 else ())
    if found.names:
        assert found.probabilities[UNEXPLAINED] == pytest.approx(max(0.1, 1.0 - share))


def test_held_out_traces_need_not_show_a_mistake_nor_what_no_round_has_seen_yet() -> None:
    first, same = (replace(each, holdout_rms=9.0) for each in (excess_round(WARM, {VOLTS_2: 4.0}), turn(None)))
    assert largest_probability(WARM, (first, same), False, DEFAULT) == 0.9
    assert named_effects((first, same), [WARM], [], False, DEFAULT, slow=False).probabilities[UNEXPLAINED] == 0.1
    only = replace(excess_round(DRAG, {DRIVE: 400.0}), holdout_rms=9.0)
    assert largest_probability(DRAG, (only,), False, DEFAULT) == 0.9, "no round began with it"


def test_one_event_that_counts_as_noise_is_no_share_without_a_name() -> None:
    rounds = (excess_round(DRAG, {DRIVE: 0.4}), excess_round(None, {DRIVE: 0.2}))
    noise = replace(rounds[1], evidence=replace(rounds[1].evidence, white=True))
    assert left_share(rounds) == pytest.approx(0.5)
    assert left_share((rounds[0], noise)) == 0.0


def test_a_mistake_must_explain_more_of_the_misfit_than_an_effect_to_be_said() -> None:
    for name, doubts in ((WARM, [WARM]), (DRAG, [])):
        rounds = (excess_round(name, {VOLTS_2: 4.0}), excess_round(None, {VOLTS_2: 1.6}))
        assert doubted_effects(rounds, [name]) == doubts


def test_beside_inexact_formulas_the_evidence_counts_a_seventh() -> None:
    first = turn("a", a=-140.0, b=-100.0)
    beside = replace(first, beside_formulas=True)
    alone, second = (questions([each, turn(None, c=5.0)], ["a"], False, DEFAULT)[0].answers for each in (first, beside))
    assert alone[NOTHING] / alone["a"] == pytest.approx(math.exp(-0.5 * 140.0 / 10.0))
    assert second[NOTHING] / second["a"] == pytest.approx(math.exp(-0.5 * 140.0 / 70.0))
    assert second["b"] / second["a"] == pytest.approx(math.exp(-0.5 * 40.0 / 70.0)), "a rival that would be accepted"
    weak = replace(turn("a", a=-140.0, b=-60.0), beside_formulas=True)
    rival = questions([weak, turn(None, c=5.0)], ["a"], False, DEFAULT)[0].answers
    assert rival["b"] / rival["a"] == pytest.approx(math.exp(-0.5 * 80.0 / 10.0)), "70 is required"


def test_an_effect_that_a_far_model_began_with_is_credited_with_the_fall_until_the_end() -> None:
    """Far from the data every model has weights of its own, and chi2 may rise where the model grows better."""
    first, rose = excess_round(FRICTION, {DRIVE: 90.0}), excess_round(DRAG, {DRIVE: 150.0})
    said = of(first, rose, excess_round(None, {DRIVE: 9.0}))
    assert said[0] == pytest.approx(81.0 / 90.0)
    worse = of(first, excess_round(None, {DRIVE: 150.0}))
    assert worse[0] == 0.0
    near = of(excess_round(FRICTION, {DRIVE: 2.0}), excess_round(DRAG, {DRIVE: 3.0}), excess_round(None, {DRIVE: 0.2}))
    assert near[0] == 0.0


@pytest.mark.parametrize(("left", "likely"), [(0.0, 0.1), (0.02, 0.1), (1.6, 0.4), (2.2, 0.9)])
def test_something_without_a_name_is_as_likely_as_its_share_of_the_misfit(left: float, likely: float) -> None:
    """Where a name explains less than half of the misfit it is in doubt: the whole misfit has no name."""
    rounds: Sequence[RoundReport] = (excess_round(DRAG, {DRIVE: 4.0}), excess_round(None, {DRIVE: left}))
    rounds = (rounds[0], RoundReport(**{**vars(rounds[1]), "candidates": rounds[0].candidates}))
    assert left_share(rounds) == pytest.approx(left / 4.0)
    assert stated(*rounds)[UNEXPLAINED] == pytest.approx(likely)
