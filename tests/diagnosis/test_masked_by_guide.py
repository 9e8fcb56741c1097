"""Which effects a fit is made anew with; that it finds one is tested on a whole folder, in test_recovery.py."""

from __future__ import annotations

import pytest

from diagnoses import score
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import Choice, Outcome
from etcfit.diagnosis.loop import Round
from etcfit.diagnosis.masked_by_guide import hidden, maskable
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
