"""What one more trace is said to tell is what it tells."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import results
from etcfit import TESTS, read_folder
from etcfit.estimation.joint_fit import fit
from etcfit.experiment.advice import Judge, advise, judged_at, separated
from etcfit.experiment.plan import PLANS, QUIET, USUAL, Setting, channels, sweeps, trace_of
from etcfit.experiment.plan import viscous as plan_viscous
from etcfit.experiment.settings import AdviceSettings, PlanSettings
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.base import Rig
from independent.effects import NONE
from independent.folder import SIZES, write_folder, write_trace
from independent.instruments import Bench
from independent.planned import record
from independent.protocols import Session
from independent.truth import CONSISTENT

VALUES = {"R_a": 1.5, "K_m": 0.019, "K_s": 0.15, "T_PL": 0.36, "T_f": 0.24}


@pytest.fixture
def setting(rig: Rig) -> Setting:
    return Setting.of_rig(rig, VALUES)


def test_as_much_again_of_everything_shrinks_every_interval_by_root_two(rig: Rig) -> None:
    layout = free_parameters(rig.config).layout
    rng = np.random.default_rng(1)
    root = rng.standard_normal((len(layout.free), len(layout.free))) * 1e3
    information = root @ root.T + 1e6 * np.eye(len(layout.free))
    judge = Judge(layout, np.zeros(len(layout.free)), information)
    shrinks, pair = judge.gain(information)
    assert shrinks == pytest.approx(np.full(shrinks.size, 0.5**0.5), rel=1e-6)
    assert pair is None  # all correlations stay


def test_the_pair_that_comes_apart_is_named() -> None:
    before = np.array([[1.0, 0.99, 0.0], [0.99, 1.0, 0.0], [0.0, 0.0, 1.0]])
    after = np.array([[0.1, 0.05, 0.0], [0.05, 0.1, 0.0], [0.0, 0.0, 1.0]])
    pair = separated(("a", "b", "c"), before, after)
    assert pair is not None
    assert (pair.symbols, pair.before, pair.after) == (("a", "b"), pytest.approx(0.99), pytest.approx(0.5))
    assert separated(("a", "b", "c"), before, before) is None
    little = np.array([[1.0, 0.988, 0.0], [0.988, 1.0, 0.0], [0.0, 0.0, 1.0]])  # 0.83 of the entanglement is left
    assert separated(("a", "b", "c"), before, little) is not None
    assert separated(("a", "b", "c"), before, little, AdviceSettings(apart=0.8)) is None


def test_it_is_judged_at_the_model_that_was_fitted_with_its_effects(rig: Rig) -> None:
    final = results.result(rig, added=("limp_home_spring",))
    known, x = judged_at(rig, final)
    assert {"K_lh", "theta_lh"} <= set(known.layout.free)
    assert x.tolist() == final.x.tolist()
    bare, _ = judged_at(rig, None)
    assert "K_lh" not in bare.layout.free


def test_a_plan_keeps_within_the_supply_and_the_travel(setting: Setting) -> None:
    assert setting.supply == 12.0
    for plan in [*(make(setting) for make in PLANS.values()), *sweeps(setting)]:
        assert plan.volts is None or np.abs(plan.volts).max() <= setting.supply
        assert setting.config.travel[0] <= plan.angle <= setting.config.travel[1]


@pytest.mark.parametrize("name", PLANS)
def test_every_plan_becomes_a_trace_of_its_test(name: str, setting: Setting) -> None:
    plan = PLANS[name](setting)
    trace = trace_of(plan, setting)
    assert trace.test.name == plan.test == name
    assert trace.channels
    assert (trace.input is None) == trace.test.boundary.terminals_open
    assert (trace.release is not None) == trace.test.boundary.released


def test_sweeps_differ_in_amplitude_and_band(setting: Setting) -> None:
    assert len({plan.says for plan in sweeps(setting)}) == 9


def test_the_settings_say_what_was_not_measured(rig: Rig) -> None:
    mine = PlanSettings(bands=(5.0,), lowest=0.5, supply=6.0, rate=10.0)
    setting = Setting.of_rig(rig, VALUES, mine)
    first, second, _ = sweeps(setting)
    assert first.says.startswith("sine sweep 0.5 to 5 Hz")
    assert first.says != second.says
    assert PLANS["back_emf"](setting).release == QUIET
    assert (setting.supply, setting.rate) == (
        12.0,
        pytest.approx(Setting.of_rig(rig, VALUES).rate),
    )  # the rig tells both


def test_a_sensor_the_rig_has_not_shown_is_assumed_and_said_to_be(setting: Setting) -> None:
    assert "motor_speed" in setting.assumed
    assert setting.noise["motor_speed"] == USUAL["motor_speed"]
    assert "motor_speed" in channels(plan_viscous(setting), setting)
    assert setting.noise["current"] != USUAL["current"]


@pytest.mark.slow
def test_what_is_predicted_comes_about(tmp_path: Path) -> None:
    """A rig without a motor-alone test: the advice asks for one, it is made as planned, and the rig is fitted again."""
    before, after = tmp_path / "before", tmp_path / "after"
    sizes = {name: series for name, series in SIZES["small"].items() if name != "viscous"}
    write_folder(before, "rig", CONSISTENT, 5, NONE, sizes, Bench(), holdout=False, noise=True)
    first = fit(read_folder(before))
    advice = advise(read_folder(before), first)

    best = advice.options[0]
    plan = best.plan
    assert plan is not None
    assert best.test == plan.test == "viscous"
    assert best.separates is not None
    assert set(best.separates.symbols) in ({"J_m", "J_L"}, {"B_m", "B_L"})
    assert {option.test for option in advice.options} | {test for test, _ in advice.not_judged} == {
        t.name for t in TESTS
    }

    shutil.copytree(before, after)
    (after / "viscous").mkdir()
    session = Session(np.random.default_rng(6), CONSISTENT, NONE, Bench())
    write_trace(after, record(session, plan.test, plan.time, plan.volts, plan.release), 6)
    second = fit(read_folder(after))
    assert first.converged
    assert second.converged

    sd = [np.sqrt(np.diag(result.covariance)) for result in (first, second)]
    for symbol, predicted, actual in zip(advice.symbols, best.shrinks, sd[1] / sd[0], strict=True):
        # a factor, for the intervals of a fit are widened where two whitenings alternate
        assert 0.5 < actual / predicted < 2.0, symbol
    assert best.shrinks[advice.symbols.index("J_m")] < 0.01
