"""Sets of effects in the free run: which effects are asked, which set is grown, and which of two is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

import results
from diagnoses import rounds
from etcfit.diagnosis import free_sets
from etcfit.diagnosis.findings import Candidate
from etcfit.diagnosis.free_sets import FreeRun, bic_change, grown, pool, preferred
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.joint_fit import quiet
from etcfit.rig.base import Rig

SETTINGS = DiagnosisSettings()
N, COUNT = 1000.0, 100.0


def run(
    error: float, size: int = 10, effects: tuple[str, ...] = (), holdout: float | None = 1.0, **changes: Any
) -> Any:
    """A free run of one channel: -log L is N log(error)."""
    fields = (effects, None, np.zeros(size), N * np.log(error), COUNT, N, holdout)
    return replace(FreeRun(*fields), **changes)  # pyright: ignore[reportArgumentType]


def test_bic_counts_independent_samples_alone() -> None:
    """2 n log(error) + k log n."""
    expected = 2.0 * COUNT * np.log(0.8) + 3.0 * np.log(COUNT)
    assert bic_change(run(0.8, size=13), run(1.0)) == pytest.approx(expected)
    assert bic_change(run(1.0, count=50.0, size=11), run(1.0)) == pytest.approx(np.log(50.0))


@pytest.mark.parametrize(
    ("other", "kept"),
    [
        (run(0.8), True),
        (run(0.8, holdout=1.19), True),
        (run(0.8, holdout=1.21), False),
        (run(0.99, size=12), False),
        (run(1.01, size=9), True),
        (run(1.01), False),
        (run(1.1, size=9), False),
    ],
    ids=["likelier", "held out a little worse", "held out worse", "no likelier", "simpler", "as good", "unlikelier"],
)
def test_likelier_or_as_likely_and_simpler(other: FreeRun, kept: bool) -> None:
    assert preferred(other, run(1.0), SETTINGS) is kept


def test_effects_that_were_worth_their_parameters_in_any_round_are_asked_the_likeliest_first(rig: Rig) -> None:
    def candidate(name: str, change: float | None) -> Candidate:
        return Candidate(name, 1.0, 1.0, change is not None, bic_change=change)

    turned = rounds(results.result(rig))[0]
    first = replace(turned, candidates=(candidate("a", -20.0), candidate("b", -9.0), candidate("c", None)))
    second = replace(turned, candidates=(candidate("d", -90.0), candidate("b", -30.0), candidate("a", 5.0)))
    assert pool((first, second), SETTINGS) == ("d", "b", "a")
    assert pool((first, second), replace(SETTINGS, free_pool=1)) == ("d",)
    assert pool((first, second), replace(SETTINGS, free_pool=0)) == ()


class End(NamedTuple):
    problem: Any
    x: Any


def test_a_set_grows_by_the_lowest_as_long_as_bic_asks_for_it_and_held_out_traces_allow(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """b strays held out and is passed over; d comes after c and is not worth its parameters: e is not asked again."""
    result = results.result(rig)
    lower = {(): 1.0, ("a",): 0.8, ("b",): 0.5, ("a", "b"): 0.4, ("a", "c"): 0.5, ("a", "c", "d"): 0.49}
    asked: list[tuple[str, ...]] = []

    def effects_of(model: Rig) -> tuple[str, ...]:
        return tuple(name for name in model.config.effects if name not in rig.config.effects)

    def lowest(problem: Any, x: Any, models: dict[str, Rig], plan: Any) -> tuple[str, None]:
        tried = {name: lower.get(effects_of(model), 9.0) for name, model in models.items()}
        asked.append(tuple(tried))
        return min(tried, key=lambda name: tried[name]), None

    def made(effects: tuple[str, ...], problem: Any, x: Any, held_out: Any) -> FreeRun:
        return run(lower[effects], 10 + len(effects), effects, holdout=2.0 if "b" in effects else 1.0)

    monkeypatch.setattr(free_sets, "model_of", lambda model: model)
    monkeypatch.setattr(free_sets, "from_own_starts", lambda model, plan: model)
    monkeypatch.setattr(free_sets, "likeliest_addition", lowest)
    monkeypatch.setattr(free_sets, "lower_end", lambda model, own, point, plan: End(None, None))
    monkeypatch.setattr(FreeRun, "of_model", made)
    found = grown(result, ("a", "b", "c", "d", "e"), quiet, SETTINGS)
    assert found.effects == ("a", "c")
    assert asked == [("a", "b", "c", "d", "e"), ("a", "c", "d", "e"), ("c", "d", "e"), ("d", "e")]
