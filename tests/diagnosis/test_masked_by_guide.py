"""Which effects a fit is made anew with; that it finds one is tested on a whole folder, in test_recovery.py."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from diagnoses import score
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import Choice, Outcome
from etcfit.diagnosis.loop import Round
from etcfit.diagnosis.rounds import Near, hidden, maskable, nearest
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS
from etcfit.rig.base import Rig
from results import result

LAG, BACKLASH, GRAVITY = (EFFECT_BY_NAME[n] for n in ("position_sensor_lag", "backlash", "gravity_load"))


def test_only_a_sensor_that_follows_late_is_hidden() -> None:
    """One that bends shows at rest too, and a delay of the current moves no angle."""
    assert [effect.name for effect in EFFECTS if effect.hidden] == ["position_sensor_lag"]


def test_a_fit_is_made_anew_with_hidden_effects_alone() -> None:
    assert maskable((BACKLASH, LAG, GRAVITY)) == (LAG,)
    assert maskable((BACKLASH, GRAVITY)) == ()


def test_where_none_is_hidden_no_fit_is_made_and_nothing_is_added(small: CandidateModel, rig: Rig) -> None:
    assert maskable(small.composition.candidates) == ()
    turned = Round(small, score(1.0), (), (), Choice(Outcome.NO_PROMISE, None, (), ""))
    assert hidden(result(rig), turned, lambda text, share: pytest.fail(text)) is None


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
