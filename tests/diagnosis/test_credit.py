"""What a name may be believed, from what it explains where it acts and what is left there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from etcfit.diagnosis.findings import Candidate, Evidence, RoundReport, Whiteness
from etcfit.diagnosis.probabilities import NOTHING, UNEXPLAINED, credits, doubted, left_share, said
from etcfit.diagnosis.settings import DEFAULT

N = 1000
VOLTS_1, VOLTS_2, DRIVE = "viscous/volts_1.csv", "viscous/volts_2.csv", "response/drive_1.csv"
WARM, GAIN, CLOCK = f"warm_start[{VOLTS_2}]", f"channel_gain[{VOLTS_2}.voltage]", "time_scale[viscous]"
FRICTION, SPRING, DRAG = "presliding_friction", "limp_home_spring", "quadratic_drag"  # inexact: 10, 2 and 2 %


def turn(added: str | None, excess: Mapping[str, float]) -> RoundReport:
    """A round that begins with so much chi2 above one a sample in each trace of N samples; noise where it is 0."""
    rows = tuple(
        Whiteness(file, file.partition("/")[0], "current", N, math.sqrt(1.0 + e), 1.0, "time", 0.0, 1.0, e == 0.0)
        for file, e in excess.items()
    )
    candidates = () if added is None else (Candidate(added, 1.0, 1.0, True, 0.9, 0.9, 0.0, -9000.0),)
    return RoundReport((), Evidence(rows, not any(excess.values()), (), ()), 1.0, 1.0, candidates, added, (), "")


def of(*rounds: RoundReport) -> list[float]:
    return credits(rounds, [each.added for each in rounds if each.added is not None])


def test_one_name_that_leaves_noise_is_believed() -> None:
    assert of(turn(WARM, {VOLTS_2: 4.0, DRIVE: 0.0}), turn(None, {VOLTS_2: 0.0, DRIVE: 0.0})) == [1.0, 1.0]


def test_a_name_that_leaves_more_than_it_explains_is_not() -> None:
    """A torque ripple that no effect has: three names explain a fifth of it."""
    said = of(turn(DRAG, {DRIVE: 6.0}), turn(SPRING, {DRIVE: 5.5}), turn(None, {DRIVE: 4.8}))
    assert said[0] == pytest.approx(0.5 / (0.5 + 4.8), abs=1e-3)
    assert max(said[:2]) < 0.2


def test_a_mistake_in_one_trace_answers_for_that_trace_and_no_other() -> None:
    elsewhere = of(turn(WARM, {VOLTS_2: 4.0, DRIVE: 9.0}), turn(None, {VOLTS_2: 0.0, DRIVE: 9.0}))
    assert elsewhere[0] == 1.0
    here = of(turn(WARM, {VOLTS_2: 4.0, DRIVE: 9.0}), turn(None, {VOLTS_2: 3.0, DRIVE: 0.0}))
    assert here[0] == pytest.approx(0.25)


def test_two_mistakes_in_one_test_are_likelier_one_thing_without_a_name() -> None:
    """A faint current limit: a warm winding, a gain and a clock of one test were each stated with 0.90."""
    said = of(
        turn(WARM, {VOLTS_2: 1.0}), turn(GAIN, {VOLTS_2: 0.5}), turn(CLOCK, {VOLTS_2: 0.2}), turn(None, {VOLTS_2: 0.0})
    )
    assert said[:3] == pytest.approx([0.5, 0.3, 0.2])


def test_mistakes_in_two_tests_are_two() -> None:
    gain = "channel_gain[response.current]"
    said = of(
        turn(WARM, {VOLTS_2: 4.0, DRIVE: 4.0}),
        turn(gain, {VOLTS_2: 0.0, DRIVE: 4.0}),
        turn(None, {VOLTS_2: 0.0, DRIVE: 0.0}),
    )
    assert said == [1.0, 1.0, 1.0]


def test_what_an_inexact_formula_may_leave_is_no_second_effect() -> None:
    first, second, _ = of(turn(FRICTION, {DRIVE: 150.0}), turn(SPRING, {DRIVE: 1.0}), turn(None, {DRIVE: 0.0}))
    assert first > 0.99
    assert second == pytest.approx(1.0 / (1.0 + 0.1**2 * 149.0))


def test_what_did_not_stay_or_was_never_seen_without_is_not_judged() -> None:
    rounds = (turn(DRAG, {DRIVE: 6.0}), turn(SPRING, {DRIVE: 5.5}))
    assert credits(rounds, [SPRING]) == [1.0, 1.0]


# ---- what is stated


def stated(*rounds: RoundReport) -> Mapping[str, float]:
    every = [each.added for each in rounds if each.added is not None]
    found = said(rounds, every, doubted(rounds, every, DEFAULT), False, DEFAULT, slow=False)
    assert all(sum(each.answers.values()) == pytest.approx(1.0) for each in found.questions)
    return found.probabilities


def test_a_name_that_is_less_likely_than_something_that_was_missed_is_not_said() -> None:
    """It came in the place of another, and no round ever found it likely."""
    rival = Candidate(SPRING, 1.0, 1.0, True, 0.9, 0.9, 0.0, 50.0)
    first = turn(DRAG, {DRIVE: 4.0})
    rounds = (replace(first, candidates=(*first.candidates, rival)), turn(None, {DRIVE: 0.0}))
    found = said(rounds, [DRAG, SPRING], [], False, DEFAULT, slow=False)
    assert (found.names, found.doubts) == ((DRAG,), (SPRING,))
    assert found.probabilities[SPRING] < DEFAULT.missed


def test_names_that_something_else_outdoes_are_in_doubt_and_what_they_explain_has_no_name() -> None:
    """All noise at the end, and yet nothing was found: four mistakes of one test."""
    rounds = (
        turn(WARM, {VOLTS_2: 1.0}),
        turn(GAIN, {VOLTS_2: 0.7}),
        turn(CLOCK, {VOLTS_2: 0.4}),
        turn(None, {VOLTS_2: 0.0}),
    )
    assert doubted(rounds, [WARM, GAIN, CLOCK], DEFAULT) == [WARM, GAIN, CLOCK]
    assert left_share(rounds, [WARM, CLOCK]) == pytest.approx(0.7)
    p = stated(*rounds)
    assert max(p[WARM], p[GAIN], p[CLOCK]) <= DEFAULT.missed
    assert p[UNEXPLAINED] == pytest.approx(1.0 - DEFAULT.lapse)
    assert p[NOTHING] < 0.1


def test_a_name_is_stated_with_no_more_than_its_credit() -> None:
    p = stated(turn(WARM, {VOLTS_2: 4.0}), turn(None, {VOLTS_2: 1.0}))
    assert p[WARM] == pytest.approx(0.75)
    sure = stated(turn(WARM, {VOLTS_2: 4.0}), turn(None, {VOLTS_2: 0.0}))
    assert sure[WARM] == pytest.approx(1.0 - DEFAULT.lapse)


@pytest.mark.parametrize(("left", "likely"), [(0.0, 0.1), (0.02, 0.1), (1.2, 0.3), (1.9, 0.475)])
def test_something_without_a_name_is_as_likely_as_its_share_of_the_misfit(left: float, likely: float) -> None:
    rounds: Sequence[RoundReport] = (turn(DRAG, {DRIVE: 4.0}), turn(None, {DRIVE: left}))
    rounds = (rounds[0], RoundReport(**{**vars(rounds[1]), "candidates": rounds[0].candidates}))
    assert left_share(rounds) == pytest.approx(left / 4.0)
    assert stated(*rounds)[UNEXPLAINED] == pytest.approx(likely)
