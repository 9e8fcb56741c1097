"""Effects found are asked again beside the rivals of their round."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from etcfit.diagnosis import exchange as look_back
from etcfit.diagnosis.ambiguity import Apart
from etcfit.diagnosis.exchange import Found, exchanged
from etcfit.estimation.joint_fit import quiet
from etcfit.model.effects import EFFECT_BY_NAME

LIMP, AIR, GRAVITY, HEAT = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "airflow_torque", "gravity_load", "winding_heating")
)
CLOSE = Apart(0.05, {})


@dataclass(frozen=True)
class Stand:
    """A model as the look back sees it."""

    added: tuple[type, ...]
    worse: bool = False
    holdout: Any = "traces"
    far: bool = False

    @property
    def weighted(self) -> Any:
        return SimpleNamespace(samples=1000.0)

    def at_work(self, effect: type) -> bool:
        return effect in self.added

    def holds(self, before: Any, was: Any) -> bool:
        return not self.worse


def verdict(
    effect: type, bic: float, chi2: float, gain: float = 500.0, added: tuple[type, ...] = (), **more: Any
) -> Any:
    score = SimpleNamespace(chi2=chi2, count=1000.0)
    standing = Stand((*added, effect), **more)
    return SimpleNamespace(effect=effect, bic_change=bic, score=score, gain=gain, standing=standing)


def stand(*added: type) -> Any:
    return Stand(added)


def found(effect: type, *rivals: type) -> Found:
    return Found(effect, {}, 100.0, {rival: {} for rival in rivals})


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[type, tuple[Any, tuple[Any, ...]]]:
    """Verdicts by the effect asked again; refits in full leave a model as it is."""
    verdicts: dict[type, tuple[Any, tuple[Any, ...]]] = {}
    monkeypatch.setattr(look_back, "_beside", lambda s, effect, rivals: verdicts[effect])
    monkeypatch.setattr(look_back, "apart", lambda a, b: CLOSE)
    monkeypatch.setattr(look_back, "refit_fully", lambda s, report: s)
    monkeypatch.setattr(look_back, "score", lambda s: None)
    return verdicts


def test_an_effect_gives_way_to_a_rival_that_explains_more_and_its_place_stays(asked: dict) -> None:
    asked[GRAVITY] = verdict(GRAVITY, -500.0, 1100.0), (verdict(AIR, -590.0, 1000.0, added=(HEAT,)),)
    s, now, words = exchanged(stand(GRAVITY, HEAT), (found(GRAVITY, AIR), found(HEAT)), quiet)
    assert s.added == (AIR, HEAT)
    assert [f.effect for f in now] == [AIR, HEAT]
    assert now[0].worth == 590.0
    assert words == ("gravity_load gave way to airflow_torque, which explains more (BIC -90.0).",)


def test_a_rival_that_does_as_well_is_a_tie_and_nothing_is_exchanged(asked: dict) -> None:
    asked[GRAVITY] = verdict(GRAVITY, -500.0, 1000.0), (verdict(AIR, -503.0, 996.0), verdict(LIMP, -400.0, 1100.0))
    s, now, words = exchanged(stand(GRAVITY), (found(GRAVITY, AIR, LIMP),), quiet)
    assert s.added == (GRAVITY,)
    assert now[0].ties == {AIR: CLOSE}
    assert words == ()


def test_a_tie_of_its_round_that_later_effects_resolve_is_a_tie_no_longer(asked: dict) -> None:
    asked[GRAVITY] = verdict(GRAVITY, -500.0, 1000.0), (verdict(AIR, -400.0, 1100.0),)
    once = Found(GRAVITY, {AIR: CLOSE}, 100.0, {AIR: {}})
    _, now, _ = exchanged(stand(GRAVITY, HEAT), (once,), quiet)
    assert now[0].ties == {}


@pytest.mark.parametrize(
    "more", [{"worse": True}, {"holdout": None}], ids=["it ends further from the data", "traces left out contradict it"]
)
def test_an_effect_stays_where_the_rival_spoils_the_model(
    asked: dict, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]
) -> None:
    monkeypatch.setattr(look_back, "folds", lambda s: (1, 2))
    monkeypatch.setattr(look_back, "left_out", lambda s: 50.0 if AIR in s.added else 40.0)
    asked[GRAVITY] = verdict(GRAVITY, -500.0, 1100.0), (verdict(AIR, -590.0, 1000.0, **more),)
    s, now, words = exchanged(stand(GRAVITY), (found(GRAVITY, AIR),), quiet)
    assert s.added == (GRAVITY,)
    assert now[0].effect is GRAVITY
    assert words == ()


def test_one_without_rivals_and_rivals_at_work_are_not_asked(asked: dict) -> None:
    tied = Found(GRAVITY, {AIR: CLOSE}, 100.0, {AIR: {}})  # in its round; now both are at work
    s, now, words = exchanged(stand(GRAVITY, AIR), (tied, found(AIR)), quiet)
    assert (s.added, words) == ((GRAVITY, AIR), ())
    assert [f.ties for f in now] == [{}, {}]


def test_rivals_are_those_that_explained_half_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(look_back, "_values", lambda v: {"a": 1.0})
    monkeypatch.setattr(look_back, "apart", lambda a, b: CLOSE)
    best, near, weak = (
        verdict(LIMP, -500.0, 1.0, 100.0),
        verdict(AIR, -9.0, 1.0, 51.0),
        verdict(HEAT, -400.0, 1.0, 49.0),
    )
    turned: Any = SimpleNamespace(best=best, ties=(AIR,), verdicts=(best, near, weak))
    assert Found.of(turned) == Found(LIMP, {AIR: CLOSE}, 500.0, {AIR: {"a": 1.0}})
