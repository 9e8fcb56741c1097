"""A model that holds another is also started from where that one ended, and ends no higher."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from driven import SOUGHT, driven, driven_rig, started
from etcfit.datasets import fetch
from etcfit.estimation.free_run import (
    Model,
    comes_near,
    fitted_free_running,
    free_run_cost,
    growing,
    no_higher_than_smaller,
    with_only,
)
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached, quiet
from etcfit.estimation.settings import FitSettings, GlobalSearchSettings
from etcfit.problem import weights
from etcfit.problem.prediction_error import pooled
from etcfit.rig.base import Fixed, Rig, Start, Tied
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, Truth, draw_truth

SMALL_SEARCH = FitSettings(reweighings=1, search=GlobalSearchSettings(points=8, epochs=2, draws=1))
NEVER_NEAR = replace(SMALL_SEARCH, misfit=0.0)
STRIBECK, DRAG = "stribeck_friction", "quadratic_drag"


@pytest.fixture(scope="module")
def truth() -> Truth:
    return draw_truth(np.random.default_rng(1), CONSISTENT)


@pytest.fixture(scope="module")
def rig(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Two effects are named that are not there; all but friction and spring is known."""
    bare = driven_rig(truth, tmp_path_factory.mktemp("nested"))
    return replace(bare, config=replace(bare.config, effects=(STRIBECK, DRAG)))


def begun(rig: Rig, truth: Truth) -> Model:
    problem = driven(rig, started(truth))
    nominal = {p.symbol: p.nominal for p in problem.layout.parameters}
    return Model(problem, problem.layout.coordinates(nominal | started(truth)))


def at_the_truth(model: Model, truth: Truth) -> np.ndarray:
    values = model.problem.layout.values(model.start, model.problem.free_parameters.held)
    return model.problem.layout.coordinates(values | {s: getattr(truth, s) for s in SOUGHT})


def caught(model: Model) -> Reached:
    """A fit that went nowhere: half the true spring and friction, twice the preload."""
    weighted = model.problem.weighted(weights.free_running(model.problem))
    return Reached(model.problem, weighted, model.start, Termination(True, "caught", far=True))


def height(reached: Reached) -> float:
    return free_run_cost(reached.problem, reached.x)


@pytest.mark.parametrize("settings", [SMALL_SEARCH, NEVER_NEAR], ids=["near", "far"])
def test_a_caught_model_ends_no_higher_than_the_smaller_ones_inside_it(
    settings: FitSettings, rig: Rig, truth: Truth
) -> None:
    """The smallest ends at the truth, the others are caught."""
    model, ends = begun(rig, truth), []

    def end_of(model: Model) -> Reached:
        if ends:
            return caught(model)
        ends.append(caught(model)._replace(x=at_the_truth(model, truth)))
        return ends[0]

    own = caught(model)
    end = no_higher_than_smaller(rig, model, own, lambda rig: begun(rig, truth), end_of, quiet, settings)
    assert height(own) > 2.0 * height(ends[0])
    assert height(end) < 1.01 * height(ends[0])  # near the data another sum is minimised than the free run's
    assert end.x.size == model.start.size
    assert comes_near(end, settings) is (settings is SMALL_SEARCH)


def test_the_effect_that_lowers_the_error_most_comes_first(rig: Rig, truth: Truth) -> None:
    asked: list[tuple[str, ...]] = []

    def end_of(model: Model) -> Reached:
        asked.append(tuple(t.name for t in model.problem.layout.types if t.name in rig.config.effects))
        return caught(model)

    order = {}
    for effects in ((STRIBECK, DRAG), (DRAG, STRIBECK)):
        named = with_only(rig, effects)
        model = begun(named, truth)
        no_higher_than_smaller(named, model, caught(model), lambda rig: begun(rig, truth), end_of, quiet, NEVER_NEAR)
        order[effects], asked = asked, []
    (first, second) = order.values()
    assert first == second
    assert first[0] == ()
    assert len(first) == 2


def test_effects_that_can_be_taken_out_are_those_to_which_nothing_is_tied(rig: Rig) -> None:
    assert growing(rig) == (STRIBECK, DRAG)
    tied = replace(rig, config=replace(rig.config, parameters={"T_f": Tied("D_q")}))
    assert growing(tied) == (STRIBECK,)


def test_without_an_effect_nothing_is_said_of_its_parameters(rig: Rig) -> None:
    """What rig.toml says of a parameter that is not there would be refused."""
    known = {"D_q": Start(1e-4), "R_a": Fixed(1.0)}
    named = replace(rig, config=replace(rig.config, parameters=known))
    less = with_only(named, (STRIBECK,))
    assert less.config.effects == (STRIBECK,)
    assert set(less.config.parameters) == {"R_a"}


def test_a_residual_as_large_as_that_of_a_far_model_is_not_near(rig: Rig, truth: Truth) -> None:
    """Whether its descent was forgiven enough or not."""
    model = begun(rig, truth)
    end = fitted_free_running(model.problem, at_the_truth(model, truth), quiet, SMALL_SEARCH)
    near = end._replace(end=Termination(True, ""))
    assert comes_near(near, SMALL_SEARCH)
    assert not comes_near(near, NEVER_NEAR)
    assert not comes_near(end, SMALL_SEARCH)


@pytest.mark.slow
def test_on_a_real_throttle_each_effect_more_ends_no_higher(measured: Path, tmp_path: Path) -> None:
    """46, 58 and 57 mV where each model was started from its own reading alone."""
    rig = read_folder(fetch("kassel-throttle", tmp_path / "kassel", measured))
    named = ("limp_home_spring", "load_dependent_friction", STRIBECK)

    def errors(result: FitResult) -> float:
        return pooled(result.score_fit)

    found = [errors(fit(replace(rig, config=replace(rig.config, effects=named[:k])))) for k in range(4)]
    assert all(larger < 1.001 * smaller for smaller, larger in pairwise(found))
    assert found[2] < 0.35 * found[0]
