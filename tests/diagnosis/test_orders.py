"""Other orders of effects far from the data: which turns are taken, and which end is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import results
from diagnoses import rounds
from etcfit.diagnosis import free_sets
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.findings import Candidate, RoundReport
from etcfit.diagnosis.free_sets import FreeRun, searched_free
from etcfit.diagnosis.orders import Turn, other_turns
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


def test_another_turn_is_one_that_bic_accepts_and_that_is_nearly_as_likely(rig: Rig) -> None:
    """a was refused for the held-out traces although it is likelier; e is 6 behind, d is not accepted by itself."""
    first = turned(rig, "b", a=-13.0, b=-10.5, c=-10.1, d=-9.0, untried=None)
    second = turned(rig, "f", e=-30.0, f=-36.0, g=-34.0)
    last = turned(rig, None, h=-11.0)
    found = other_turns((first, second, last), replace(SETTINGS, orders=4))
    assert [(turn.round, turn.instead) for turn in found] == [(0, "a"), (0, "c"), (1, "g")]
    assert found[0].behind == pytest.approx(-2.5)
    assert other_turns((first, second), replace(SETTINGS, orders=1)) == [Turn(found[0].behind, 0, "a")]
    assert other_turns((first, second), replace(SETTINGS, orders=0)) == []


@pytest.mark.parametrize(("error", "held_out", "taken"), [(0.7, 1.1, True), (0.7, 1.3, False), (0.99, 1.0, False)])
def test_the_end_of_another_order_is_kept_where_its_free_run_is_preferred(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, error: float, held_out: float, taken: bool
) -> None:
    result = results.result(rig)
    first = start(result, SETTINGS)
    limp, air = (EFFECT_BY_NAME[name] for name in ("limp_home_spring", "airflow_torque"))
    own, other = (Progress(first, (Found(effect, {}, {}),), ()) for effect in (limp, air))

    def free_run(which: Any, _: Any) -> FreeRun:
        is_own = not runs
        runs.append(which)
        error_now, held = (1.0, 1.0) if is_own else (error, held_out)
        name = "limp_home_spring" if is_own else "airflow_torque"
        return FreeRun((name,), result.problem, np.zeros(10), 1000.0 * np.log(error_now), 100.0, 1000.0, held)

    runs: list[Any] = []
    monkeypatch.setattr(free_sets, "other_orders", lambda *_: iter([other]))
    monkeypatch.setattr(free_sets, "best_free_run", free_run)
    after, (tried,) = searched_free(result, first, own, quiet)
    assert (tried.effects, tried.taken) == (("airflow_torque",), taken)
    assert tried.bic_change == pytest.approx(200.0 * np.log(error))
    assert after.found == (other if taken else own).found
    said = ("limp_home_spring gave way to airflow_torque, whose free run is likelier (BIC -71.3).",)
    assert after.changed == (said if taken else ())
