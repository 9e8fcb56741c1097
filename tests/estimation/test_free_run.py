"""The guide along the measured angle: how stiff it is, and where it leads when it is let go."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodies import OPEN, N
from driven import SOUGHT, driven, driven_rig, started
from etcfit.datasets import fetch
from etcfit.estimation import free_run, joint_fit
from etcfit.estimation.free_run import (
    Guided,
    Model,
    comes_near,
    fitted_free_running,
    free_run_cost,
    guide_stiffness,
    guide_stiffness_of,
    likeliest_addition,
    no_higher_than_smaller,
    relax_guide,
    removable_effects,
    with_only,
)
from etcfit.estimation.joint_fit import FitResult, fit, from_own_starts
from etcfit.estimation.levenberg_marquardt import minimise
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached, quiet
from etcfit.estimation.settings import FitSettings, GlobalSearchSettings
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.prediction_error import pooled
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.base import Fixed, Rig, Start, Tied
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, TABLE_2, Truth, draw_truth
from independent.folder import make_folder

SETTINGS = FitSettings()


# ---- how stiff


def stiffness(truth: Truth, span: float, rate: float = 1000.0, torque: bool = False, **changes: float) -> float:
    values = {s: getattr(truth, s) for s in ("J_m", "J_L", "T_f", "R_a", "L_a", "K_b", "K_m")}
    return guide_stiffness(values | changes, N, Guided(span, rate, torque))


@pytest.mark.parametrize("travel", [OPEN, 0.1], ids=["whole travel", "a twentieth of it"])
@pytest.mark.parametrize("truth", [CONSISTENT, TABLE_2], ids=["light", "heavy"])
def test_a_guided_plate_is_stable(truth: Truth, travel: float) -> None:
    """L J s^3 + (R J + L B) s^2 + ((N K)^2 + R B + L K_s) s + R K_s + N K pull has no root on the right."""
    pull = stiffness(truth, travel)
    coil = N * truth.K_b
    roots = np.roots([
        truth.L_a * truth.J_eq,
        truth.R_a * truth.J_eq + truth.L_a * truth.B_eq,
        coil**2 + truth.R_a * truth.B_eq + truth.L_a * truth.K_s,
        truth.R_a * truth.K_s + coil * pull,
    ])  # fmt: skip
    assert pull > 0.0
    assert np.max(roots.real) < 0.0


def test_a_guide_in_volts_is_as_stiff_as_one_in_torque() -> None:
    volts, torque = stiffness(CONSISTENT, OPEN), stiffness(CONSISTENT, OPEN, torque=True)
    assert volts * N * CONSISTENT.K_m / CONSISTENT.R_a == pytest.approx(torque, rel=1e-6)


def test_a_guide_gives_way_to_dry_friction_by_a_hundredth_of_the_travel() -> None:
    for travel in (OPEN, 0.5):
        assert CONSISTENT.T_f / stiffness(CONSISTENT, travel, torque=True) == pytest.approx(0.01 * travel, rel=1e-3)


@pytest.mark.parametrize(("rate", "hertz"), [(1000.0, 15.0), (30.0, 3.0)])
def test_without_dry_friction_a_guide_has_a_share_of_its_bandwidths_stiffness(rate: float, hertz: float) -> None:
    """0.003 J w^2, w of 15 Hz or a tenth of the sample rate."""
    expected = 0.003 * CONSISTENT.J_eq * (2.0 * np.pi * hertz) ** 2
    assert stiffness(CONSISTENT, OPEN, rate, torque=True, T_f=0.0) == pytest.approx(expected, rel=1e-3)


def asked() -> float:
    """Stiffness without dry friction, N m/rad."""
    values = {s: getattr(CONSISTENT, s) for s in ("J_m", "J_L", "R_a", "L_a", "K_b", "K_m")} | {"T_f": 0.0}
    return guide_stiffness(values, N, Guided(OPEN, 30.0, True))


@pytest.mark.parametrize(
    ("name", "value", "times"),
    [("LEAST", 0.006, 2.0), ("BANDWIDTH_OF_RATE", 0.2, 4.0), ("BANDWIDTH", 1.5, 0.25), ("GIVE", 0.5, 1.0)],
)
def test_a_constant_changes_what_it_names(
    name: str, value: float, times: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = asked()
    monkeypatch.setattr(free_run, name, value)
    assert asked() == pytest.approx(times * before)


# ---- where it leads


@pytest.fixture(scope="module")
def truth() -> Truth:
    return draw_truth(np.random.default_rng(1), CONSISTENT)


@pytest.fixture(scope="module")
def problem(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> EstimationProblem:
    """Friction and spring are sought."""
    return driven(driven_rig(truth, tmp_path_factory.mktemp("driven")), started(truth))


def off(problem: EstimationProblem, x: np.ndarray, truth: Truth) -> float:
    """Largest relative error of what is sought."""
    values = problem.layout.values(x, problem.free_parameters.held)
    return max(abs(float(values[s]) / getattr(truth, s) - 1.0) for s in SOUGHT)


def test_it_leads_where_a_descent_is_caught(problem: EstimationProblem, truth: Truth) -> None:
    x = problem.layout.coordinates(started(truth))
    assert set(problem.layout.free) == set(SOUGHT)
    assert off(problem, x, truth) > 0.4
    weighted = problem.weighted(weights.free_running(problem))
    caught, _ = minimise(problem, x, weighted, SETTINGS.tolerance, SETTINGS.steps)
    assert off(problem, caught, truth) > 0.4
    led = relax_guide(problem, x)
    assert off(problem, led, truth) < 0.005
    assert free_run_cost(problem, led) < 0.2 * free_run_cost(problem, caught)


def test_a_free_run_that_is_likelier_already_stays(problem: EstimationProblem, truth: Truth) -> None:
    """Its end is never less likely than where it began."""
    x = problem.layout.coordinates({**started(truth), **{s: getattr(truth, s) for s in SOUGHT}})
    there = relax_guide(problem, x)
    again = relax_guide(problem, there)
    assert free_run_cost(problem, again) <= free_run_cost(problem, there) <= free_run_cost(problem, x)


def test_the_guide_is_as_stiff_as_the_logged_angle_asks(problem: EstimationProblem, truth: Truth) -> None:
    """Largest travel of a trace and median rate of all."""
    x = problem.layout.coordinates(started(truth))
    traces = problem.batch.traces
    span = max(float(np.ptp(trace.data[:, 0])) for trace in traces)
    rate = 1.0 / float(np.median(np.concatenate([np.diff(trace.instants) for trace in traces])))
    values = problem.layout.values(x, problem.free_parameters.held)
    expected = guide_stiffness(values, problem.config.gear_ratio, Guided(span, rate, False))
    assert guide_stiffness_of(problem, x) == pytest.approx(expected, rel=1e-9)


def test_without_a_logged_angle_there_is_no_guide_and_nothing_moves(truth: Truth, tmp_path: Path) -> None:
    make_folder(tmp_path, truth, 1, size="small")
    rig = read_folder(tmp_path)
    found = [prepare(m, rig.config) for m in rig.measurements if m.test == "resistance"]
    known = free_parameters(rig.config)
    blind = EstimationProblem.of_traces(rig.config, known, tuple(trace for trace in found if trace is not None))
    x = known.layout.coordinates({p.symbol: p.nominal for p in known.layout.parameters})
    assert guide_stiffness_of(blind, x) == 0.0
    assert relax_guide(blind, x) is x


# ---- A model that holds another is also started from where that one ended, and ends no higher

SMALL_SEARCH = FitSettings(search=GlobalSearchSettings(points=8, epochs=2, draws=1))
NEVER_NEAR = replace(SMALL_SEARCH, misfit=0.0)
STRIBECK, DRAG = "stribeck_friction", "quadratic_drag"


@pytest.fixture
def one_weighing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_run, "REWEIGHINGS", 1)


@pytest.fixture(scope="module")
def rig(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """One response; two effects are named that are not there, and all but friction and spring is known."""
    bare = driven_rig(truth, tmp_path_factory.mktemp("nested"))
    one = tuple(m for m in bare.measurements if m.file == "response/drive_1.csv")
    return replace(bare, config=replace(bare.config, effects=(STRIBECK, DRAG)), measurements=one)


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


@pytest.mark.slow
@pytest.mark.usefixtures("one_weighing")
@pytest.mark.parametrize("settings", [SMALL_SEARCH, NEVER_NEAR], ids=["near", "far"])
def test_a_caught_model_ends_no_higher_than_the_smaller_ones_inside_it(
    settings: FitSettings, rig: Rig, truth: Truth
) -> None:
    """The smallest ends at the truth, the others are caught."""
    model, ends = begun(rig, truth), []
    asked: list[tuple[str, ...]] = []

    def end_of(model: Model) -> Reached:
        asked.append(tuple(t.name for t in model.problem.layout.types if t.name in rig.config.effects))
        if ends:
            return caught(model)
        ends.append(caught(model)._replace(x=at_the_truth(model, truth)))
        return ends[0]

    own = caught(model)
    end = no_higher_than_smaller(rig, model, own, lambda rig: begun(rig, truth), end_of, quiet, settings)
    assert height(own) > 2.0 * height(ends[0])
    assert height(end) < 1.01 * height(ends[0])  # near the data another sum is minimised than the free run's
    assert end.x.size == model.start.size
    assert asked in ([(), (STRIBECK,)], [(), (DRAG,)])  # without either, then with one
    assert comes_near(end, settings) is (settings is SMALL_SEARCH)


@pytest.mark.slow
def test_the_effect_that_lowers_the_error_most_comes_first_whatever_their_order(rig: Rig, truth: Truth) -> None:
    smaller = begun(with_only(rig, ()), truth)
    larger = {name: begun(with_only(rig, (name,)), truth) for name in (STRIBECK, DRAG)}

    def first(*names: str) -> tuple[str, float]:
        models = {name: larger[name] for name in names}
        best, point = likeliest_addition(smaller.problem, smaller.start, models, SMALL_SEARCH)
        return best, free_run_cost(larger[best].problem, point)

    lowest = min((first(name) for name in larger), key=lambda found: found[1])
    assert first(*larger) == first(*reversed(larger)) == lowest


def test_effects_that_can_be_taken_out_are_those_to_which_nothing_is_tied(rig: Rig) -> None:
    assert removable_effects(rig) == (STRIBECK, DRAG)
    tied = replace(rig, config=replace(rig.config, parameters={"T_f": Tied("D_q")}))
    assert removable_effects(tied) == (STRIBECK,)


def test_without_an_effect_nothing_is_said_of_its_parameters(rig: Rig) -> None:
    """What rig.toml says of a parameter that is not there would be refused."""
    known = {"D_q": Start(1e-4), "R_a": Fixed(1.0)}
    named = replace(rig, config=replace(rig.config, parameters=known))
    less = with_only(named, (STRIBECK,))
    assert less.config.effects == (STRIBECK,)
    assert set(less.config.parameters) == {"R_a"}


@pytest.mark.usefixtures("one_weighing")
def test_a_residual_as_large_as_that_of_a_far_model_is_not_near(rig: Rig, truth: Truth) -> None:
    """Whether its descent was forgiven enough or not."""
    model = begun(rig, truth)
    end = fitted_free_running(model.problem, at_the_truth(model, truth), quiet, SMALL_SEARCH)
    near = end._replace(end=Termination(True, ""))
    assert comes_near(near, SMALL_SEARCH)
    assert not comes_near(near, NEVER_NEAR)
    assert not comes_near(end, SMALL_SEARCH)


@pytest.mark.slow
def test_on_a_real_throttle_each_effect_more_ends_no_higher(
    measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """46 and 58 mV where each model was started from its own reading alone.

    Where a smaller model ends is computed once, though each larger one asks for it: data, settings and seed are the
    same.
    """
    ends, settings = dict[Any, Reached](), FitSettings()

    def once(model: Model, given: FitSettings) -> Reached:
        assert given == settings
        types = model.problem.layout.types
        if types not in ends:
            ends[types] = from_own_starts(model, given)
        return ends[types]

    monkeypatch.setattr(joint_fit, "from_own_starts", once)
    rig = read_folder(fetch("kassel-throttle", tmp_path / "kassel", measured))
    named = ("limp_home_spring", "load_dependent_friction")

    def errors(result: FitResult) -> float:
        return pooled(result.score_fit)

    found = [errors(fit(replace(rig, config=replace(rig.config, effects=named[:k])))) for k in range(3)]
    assert all(larger < 1.001 * smaller for smaller, larger in pairwise(found))
    assert found[2] < 0.35 * found[0]
