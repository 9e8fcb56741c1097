"""The guide along the measured angle: how stiff it is, and where it leads when it is let go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodies import OPEN, N
from driven import SOUGHT, driven, driven_rig, started
from etcfit.estimation.free_run import Guided, free_run_cost, guide_stiffness, guide_stiffness_of, relax_guide
from etcfit.estimation.levenberg_marquardt import minimise
from etcfit.estimation.settings import FitSettings, GuideSettings
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, TABLE_2, Truth, draw_truth
from independent.folder import make_folder

SETTINGS = FitSettings()


# ---- how stiff


def stiffness(truth: Truth, span: float, rate: float = 1000.0, torque: bool = False, **changes: float) -> float:
    values = {s: getattr(truth, s) for s in ("J_m", "J_L", "T_f", "R_a", "L_a", "K_b", "K_m")}
    return guide_stiffness(values | changes, N, Guided(span, rate, torque), GuideSettings())


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


def asked(**changes: float) -> float:
    """Stiffness without dry friction, N m/rad."""
    values = {s: getattr(CONSISTENT, s) for s in ("J_m", "J_L", "R_a", "L_a", "K_b", "K_m")} | {"T_f": 0.0}
    return guide_stiffness(values, N, Guided(OPEN, 30.0, True), replace(GuideSettings(), **changes))


@pytest.mark.parametrize(
    ("changes", "times"),
    [({"least": 0.006}, 2.0), ({"bandwidth_of_rate": 0.2}, 4.0), ({"bandwidth": 1.5}, 0.25), ({"give": 0.5}, 1.0)],
)
def test_a_setting_changes_what_it_names(changes: dict[str, float], times: float) -> None:
    assert asked(**changes) == pytest.approx(times * asked())


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
    expected = guide_stiffness(values, problem.config.gear_ratio, Guided(span, rate, False), GuideSettings())
    assert guide_stiffness_of(problem, x, GuideSettings()) == pytest.approx(expected, rel=1e-9)


def test_without_a_logged_angle_there_is_no_guide_and_nothing_moves(truth: Truth, tmp_path: Path) -> None:
    make_folder(tmp_path, truth, 1, size="small")
    rig = read_folder(tmp_path)
    found = [prepare(m, rig.config) for m in rig.measurements if m.test == "resistance"]
    known = free_parameters(rig.config)
    blind = EstimationProblem.of(rig.config, known, tuple(trace for trace in found if trace is not None))
    x = known.layout.coordinates({p.symbol: p.nominal for p in known.layout.parameters})
    assert guide_stiffness_of(blind, x, GuideSettings()) == 0.0
    assert relax_guide(blind, x) is x
