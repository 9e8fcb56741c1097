"""Which effects a fit is made anew with, and when."""

from __future__ import annotations

from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from etcfit.diagnosis.masked_by_guide import hidden
from etcfit.estimation.joint_fit import quiet
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS

module = import_module("etcfit.diagnosis.masked_by_guide")  # the package's own `hidden` is the function
LAG, BACKLASH, GRAVITY = (EFFECT_BY_NAME[n] for n in ("position_sensor_lag", "backlash", "gravity_load"))


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> dict[type, Any]:
    """Models by the effect tried; the keys are those asked for."""
    asked: dict[type, Any] = {}

    def anew(result: Any, turned: Any, effect: type, report: Any) -> Any:
        asked[effect] = result
        return result

    monkeypatch.setattr(module, "_with", anew)
    monkeypatch.setattr(module, "_round", lambda turned, s, effect: effect)
    return asked


def first(*candidates: type) -> Any:
    return SimpleNamespace(before=SimpleNamespace(composition=SimpleNamespace(candidates=candidates)))


def test_only_a_sensor_that_follows_late_is_hidden() -> None:
    """One that bends shows at rest too, and a delay of the current moves no angle."""
    assert [effect.name for effect in EFFECTS if effect.hidden] == ["position_sensor_lag"]


def test_a_fit_is_made_anew_with_hidden_effects_alone(tried: dict[type, Any]) -> None:
    result: Any = "near"
    assert hidden(result, first(BACKLASH, LAG, GRAVITY), quiet) == (LAG, "near")
    assert list(tried) == [LAG]


def test_where_none_is_hidden_or_none_comes_near_nothing_is_added(tried: dict[type, Any]) -> None:
    result: Any = None
    assert hidden(result, first(BACKLASH, GRAVITY), quiet) is None
    assert not tried
    assert hidden(result, first(BACKLASH, LAG), quiet) is None
    assert list(tried) == [LAG]
