"""Other orders of effects far from the data: which turns are taken, and which end is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import results
from diagnoses import rounds
from etcfit.diagnosis import free_sets
from etcfit.diagnosis.composition import resting
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.findings import Candidate, RoundReport
from etcfit.diagnosis.free_sets import FreeRun, searched_free
from etcfit.diagnosis.orders import other_orders, other_turns
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.rounds import Progress
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.joint_fit import quiet
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.rig.base import Rig

SETTINGS = DiagnosisSettings()


def turned(rig: Rig, added: str | None, **changes: float | None) -> RoundReport:
    candidates = tuple(Candidate(name, 1.0, 1.0, True, bic_change=change) for name, change in changes.items())
    return replace(rounds(results.result(rig))[0], added=added, candidates=candidates)


def found(effect: str, *rivals: str) -> Found:
    """An effect, and others that were refitted, each with the values at which its refit ended."""
    ends = {EFFECT_BY_NAME[name]: {s: 0.3 for s in resting(EFFECT_BY_NAME[name])} for name in rivals}
    return Found(EFFECT_BY_NAME[effect], {}, ends)


LIMP, AIR, DRAG, GRAVITY, HEAT = (
    "limp_home_spring", "airflow_torque", "quadratic_drag", "gravity_load", "winding_heating"
)  # fmt: skip


def test_another_turn_is_one_that_bic_accepts_and_that_is_as_likely(rig: Rig) -> None:
    """The airflow is likelier, but held-out traces refused it; heat is not accepted by itself; the other gravity is 6
    behind."""
    first = turned(rig, LIMP, **{AIR: -13.0, LIMP: -10.5, DRAG: -10.1, HEAT: -9.0, GRAVITY: None})
    second = turned(rig, DRAG, **{GRAVITY: -30.0, DRAG: -36.0, HEAT: -35.0})
    last = turned(rig, None, **{HEAT: -11.0})
    of_rounds = [found(LIMP, AIR, DRAG, HEAT), found(DRAG, GRAVITY, HEAT)]

    def turns(orders: int, known: list[Found] = of_rounds) -> list[tuple[int, str]]:
        every = other_turns((first, second, last), known, replace(SETTINGS, orders=orders))
        return [(turn.round, turn.instead) for turn in every]

    assert turns(9) == [(0, DRAG), (1, HEAT), (0, AIR)]
    assert turns(1) == [(0, DRAG)]
    assert turns(0) == []
    assert turns(9, [found(LIMP), found(DRAG, HEAT)]) == [(1, HEAT)], "the others were not refitted or explained little"
    assert turns(9, [found(AIR, LIMP, DRAG), found(DRAG, HEAT)]) == [], "the first took the place of another later"


def test_the_rounds_are_carried_on_from_the_refit_of_the_other(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    result = results.result(rig)
    first = start(result, SETTINGS)
    one = turned(rig, LIMP, **{LIMP: -50.0})
    two = turned(rig, DRAG, **{DRAG: -36.0, AIR: -35.0})
    done = Progress(first, (found(LIMP), found(DRAG, AIR)), (one, two, turned(rig, None)))
    values = next(iter(done.found[1].rivals.values()))
    done.found[1].rivals[EFFECT_BY_NAME[AIR]].update({s: 0.2 for s in resting(EFFECT_BY_NAME[LIMP])})  # pyright: ignore
    monkeypatch.setattr("etcfit.diagnosis.orders.refit_fully", lambda s, report: s)
    monkeypatch.setattr("etcfit.diagnosis.orders.forward", lambda result, progress, report: progress)
    monkeypatch.setattr("etcfit.diagnosis.orders.looked_back", lambda result, progress, report: progress)
    (other,) = other_orders(result, first, done, quiet)
    assert [e.name for e in other.model.added] == [LIMP, AIR]
    assert {s: pytest.approx(other.model.values[s]) for s in values} == values
    assert [each.added for each in other.rounds] == [LIMP, AIR]
    assert other.rounds[1].ties == (DRAG,)
    assert [each.effect.name for each in other.found] == [LIMP, AIR]


@pytest.mark.parametrize(("error", "held_out", "taken"), [(0.7, 1.1, True), (0.7, 1.3, False), (0.99, 1.0, False)])
def test_the_end_of_another_order_is_kept_where_its_free_run_is_preferred(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, error: float, held_out: float, taken: bool
) -> None:
    result = results.result(rig)
    first = start(result, SETTINGS)
    accepted = (turned(rig, LIMP, **{LIMP: -50.0}),)
    own, other = (Progress(first, (found(name),), accepted) for name in (LIMP, AIR))

    def free_run(which: Any, _: Any) -> FreeRun:
        is_own = not runs
        runs.append(which)
        error_now, held = (1.0, 1.0) if is_own else (error, held_out)
        name = LIMP if is_own else AIR
        return FreeRun((name,), result.problem, np.zeros(10), 1000.0 * np.log(error_now), 100.0, 1000.0, held)

    runs: list[Any] = []
    monkeypatch.setattr(free_sets, "other_orders", lambda *_: iter([other]))
    monkeypatch.setattr(free_sets, "best_free_run", free_run)
    none = FreeRun((), result.problem, result.x, 1e9, 100.0, 1000.0, 1.0)  # no set grown, as in the models made by hand
    monkeypatch.setattr(free_sets, "grown", lambda *_: none)
    after, (tried,) = searched_free(result, first, own, quiet)
    assert (tried.effects, tried.taken) == ((AIR,), taken)
    assert tried.bic_change == pytest.approx(200.0 * np.log(error))
    assert after.found == (other if taken else own).found
    said = ("limp_home_spring gave way to airflow_torque, whose free run is likelier (BIC -71.3).",)
    assert after.changed == (said if taken else ())
