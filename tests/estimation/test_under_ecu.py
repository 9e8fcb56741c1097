"""Traces that log setpoint and position alone: the ECU is part of the model, its gains known or sought."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ecu_folders import COMPUTER, FREE, GAINS, KNOWN, under_ecu
from etcfit.control.setpoint import trapezoid
from etcfit.diagnosis.composition import compose
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.estimation.ready import ready
from etcfit.estimation.settings import FitSettings
from etcfit.model.ecu import Ecu
from etcfit.model.effects import COMMANDING
from etcfit.problem.batch import batch_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.instants import SHARES
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.setpoint import Setpoint
from etcfit.problem.ticks import tick_instants
from etcfit.problem.trace import prepare
from etcfit.rig.base import Fixed, Measurement, Prior, Rig, RigConfig, Start
from etcfit.rig.paper_readings import Readings, read_graphs
from etcfit.rig.reader import read_folder
from independent import NONE, Truth, draw_truth
from independent.control import helped
from independent.simulate import throttle
from independent.strengths import MEDIUM
from independent.truth import OPEN
from independent.under_ecu import Log
from independent.under_ecu import setpoint as ecu_setpoint
from measurements import channel, prepared
from rigs import loop, one

ECU = Ecu()
CONFIG = RigConfig(
    "bench", gear_ratio=20.68, supply_V=12.0, ecu=ECU, parameters={s: Fixed(v) for s, v in ECU.constants.items()}
)


def logged(test: str = "closed_loop", n: int = 40, **more: np.ndarray) -> Measurement:
    """Position and a setpoint that rises by 1 rad/s from 10 ms on."""
    time = 2e-3 * np.arange(n)
    values = {"position": np.full(n, 0.5), "setpoint": 0.5 + np.maximum(time - 0.01, 0.0), **more}
    return Measurement(f"{test}/a.csv", test, time, {q: channel(time, v, 1e-3) for q, v in values.items()})


# ---- what becomes of the trace


@pytest.mark.parametrize("test", ["closed_loop", "sine", "drive"])
def test_a_setpoint_makes_a_trace_that_the_ecu_drives(test: str) -> None:
    trace = prepared(logged(test), CONFIG)
    assert trace.controlled
    assert trace.circuit
    assert trace.channels == ("position",)


def test_a_logged_voltage_is_believed_before_the_ecu() -> None:
    trace = prepared(logged(voltage=np.full(40, 3.0)), CONFIG)
    assert not trace.controlled


def test_without_an_ecu_it_is_left_out_and_told_what_would_make_it_count() -> None:
    rig = Rig("bench", replace(CONFIG, ecu=None), (logged(), logged(voltage=np.linspace(0.0, 3.0, 40))))
    fitted, _, notes = ready(rig)
    assert prepare(rig.measurements[0], rig.config) is None
    assert len(fitted) == 1
    assert "[ecu]" in notes[0]
    assert "closed_loop/a.csv: no voltage" in notes[0]


def test_an_ecu_that_no_trace_needs_is_named() -> None:
    _, _, notes = ready(Rig("bench", CONFIG, (logged(voltage=np.linspace(0.0, 3.0, 40)),)))
    assert len(notes) == 1
    assert "no trace needs [ecu]" in notes[0]
    assert ready(Rig("bench", CONFIG, (logged(),)))[2] == ()


def test_every_tick_begins_a_step_and_carries_the_setpoint_that_was_read() -> None:
    trace = prepared(logged(), CONFIG)
    steps = batch_of([trace], CONFIG, [np.ones(39, int)]).steps
    assert steps.command is not None
    begins, ticks = np.asarray(steps.time - steps.dt)[:, 0], np.asarray(steps.command.tick)[:, 0] > 0.5
    # 78 ms at 1 ms, each in step with a sample or between two; a clock that ticks with a sample ticks just after it
    assert_allclose(begins[ticks], 1e-3 * np.arange(78), atol=2e-7)
    wanted = 0.5 + np.maximum(begins[ticks] - 0.01, 0.0)  # the ramp begins at a sample
    assert_allclose(np.asarray(steps.command.setpoint)[ticks, 0], wanted, atol=1e-9)


def jumping(at: float, **more: Any) -> Setpoint:
    """The setpoint of a log at 500 Hz that jumps between two samples, as an ECU saw it at a share of the window."""
    time = 2e-3 * np.arange(40)
    trace = prepared(logged(setpoint=np.where(time > 0.0301, 0.9, 0.5), **more), CONFIG)
    assert trace.setpoint is not None
    assert_array_equal(trace.setpoint.jumps, [15])
    return trace.setpoint.with_jumps_at(at)


@pytest.mark.parametrize(("share", "seen"), [(0.0, 0.030), (1.0 / 3.0, 0.031), (0.5, 0.0315), (1.0, 0.033)])
def test_a_jump_is_seen_within_an_interval_and_a_period_and_the_clock_ticks_with_it(share: float, seen: float) -> None:
    setpoint = jumping(share)
    assert_allclose(setpoint.seen, [seen])
    ticks = tick_instants(setpoint, ECU)
    assert np.min(np.abs(ticks - seen)) < 1e-9
    assert_allclose(setpoint.at(np.array([seen - 1e-6, seen + 1e-6])), [0.5, 0.9], atol=1e-9)
    apart = np.diff(ticks)
    assert np.all((apart > 0.45e-3) & (apart < 1.55e-3))


@pytest.mark.parametrize("period", [2e-3, 2e-3 * (1.0 - 1e-9), 1e-3])
@pytest.mark.parametrize("delay", [0.0, 1.5e-3, 2e-3, 5e-3])
def test_a_jump_seen_later_is_laid_out_as_in_a_new_batch(period: float, delay: float) -> None:
    """Of a log with a row for each tick, which acts a tick later, and others."""
    config = replace(CONFIG, ecu=ECU._replace(period=period, delay=delay))
    time = 2e-3 * np.arange(40)
    asked = np.where(time > 0.0301, 0.9, 0.5) - 0.3 * (time > 0.0321)
    first = prepared(logged(setpoint=asked), config)
    batch = batch_of([first], config, [np.ones(39, int)])
    for share in np.linspace(0.0, 1.0, 9):
        trace = first.with_jumps_at(float(share))
        found = batch.with_times_of([trace], config, [np.ones(39, int)])
        wanted = batch_of([trace], config, [np.ones(39, int)])
        for part in ("steps", "slots", "disturbance"):
            for column, anew in zip(*(jax.tree.leaves(getattr(each, part)) for each in (found, wanted)), strict=True):
                assert_array_equal(column, anew)


def test_steps_follow_the_instant_of_a_jump_as_their_columns_say() -> None:
    """Lengths of all steps for two instants 10 us apart, both laid out anew."""
    time = 2e-3 * np.arange(40)
    trace = prepared(logged(setpoint=np.where(time > 0.0301, 0.9, 0.5)), CONFIG)
    by = 1e-5
    early, late = (trace.with_jumps_at((0.0012 + shift) / 0.003) for shift in (0.0, by))
    first, then = (batch_of([t], CONFIG, [np.full(39, 2)]) for t in (early, late))
    follows = np.asarray(first.disturbance.follows)[:, 0]
    assert first.steps.command is not None
    marks = first.places[0][2]
    ends = np.flatnonzero(np.asarray(first.steps.command.tick)[:, 0]) - 1  # of steps that end at a tick
    moved = np.cumsum(np.asarray(then.steps.dt - first.steps.dt)[:, 0])
    assert_allclose(moved[ends], np.cumsum(by * follows)[ends], atol=1e-9)
    assert_allclose(moved[marks], 0.0, atol=1e-9)
    assert_allclose(np.cumsum(follows)[marks], 0.0, atol=1e-9)
    assert_allclose(moved[ends[ends > marks[16]]], by, atol=1e-9)  # those after the jump move with it, all of them
    rows = np.flatnonzero(np.asarray(first.disturbance.seen))
    assert rows.size == 1
    assert follows[rows[0] + 1] == 1.0
    assert_allclose(follows[: rows[0] + 1], 0.0)


def test_a_ramp_has_no_jump() -> None:
    trace = prepared(logged(), CONFIG)
    assert trace.setpoint is not None
    assert trace.setpoint.jumps.size == 0


def test_a_jump_is_placed_where_the_plate_answered() -> None:
    """A plate that runs off at 3 rad/s from the instant it is asked to, in plain numbers."""
    time, true = 2e-3 * np.arange(40), 0.7
    setpoint = jumping(0.5)

    def path(share: float) -> np.ndarray:
        return 0.5 + 3.0 * np.maximum(time - (0.030 + share * 0.003), 0.0)

    noise = 1e-3 * np.random.default_rng(1).standard_normal(40)
    placed = setpoint.placed(path(true) + noise, 1e-3, [path(share) for share in SHARES])
    assert placed.share[0] == pytest.approx(true, abs=0.15)
    nothing = setpoint.placed(np.full(40, np.nan), 1e-3, [path(share) for share in SHARES])
    assert_array_equal(nothing.share, [0.5])


def test_a_rig_without_an_ecu_has_nothing_of_it_on_its_tape_or_in_its_model() -> None:
    """So that its compiled programs are those they always were."""
    plain = replace(CONFIG, ecu=None, parameters={})
    trace = prepared(logged(voltage=np.full(40, 3.0)), plain)
    steps = batch_of([trace], plain, [np.ones(39, int)]).steps
    assert steps.command is None
    assert steps.inputs(0.5).controlled is None
    assert not set(COMMANDING) & set(free_parameters(plain).layout.types)


def test_another_voltage_in_the_integral_is_one_on_the_tape_of_this_trace_alone() -> None:
    traces = [prepare(logged(), CONFIG), prepare(logged(voltage=np.full(40, 3.0)), CONFIG)]
    batch = batch_of([t for t in traces if t is not None], CONFIG, [np.ones(39, int)] * 2)
    held = batch.holding(np.array([1.5, 9.0]))
    (lane, row, marks), (other, begin, ends) = held.places
    for column in (held.steps.voltage0, held.steps.voltage1):
        assert_array_equal(column[row : marks[-1] + 1, lane], 1.5)
        assert_allclose(column[begin : ends[-1] + 1, other], 3.0, atol=1e-9)
    assert held.traces[0].input is not None
    assert_array_equal(held.traces[0].input.value, 1.5)


def test_gains_are_fixed_sought_or_believed_as_rig_toml_says() -> None:
    told = {"K_p": Fixed(4.0), "K_i": Prior(30.0, 3.0), "K_d": Start(0.2)}
    u = free_parameters(replace(CONFIG, parameters={**CONFIG.parameters, **told}))
    assert u.layout.status("K_p") == "fixed"
    assert {"K_i", "K_d"} <= set(u.layout.free)
    assert u.priors == {"K_i": (30.0, 3.0)}
    assert u.start["K_d"] == 0.2
    assert {"t_e", "tau_e", "t_l", "V_e"} <= set(u.layout.held)


def test_the_model_of_all_effects_carries_the_controller_along() -> None:
    trace = prepared(logged(), CONFIG)
    composition = compose(Rig("bench", CONFIG, (logged(),)), (trace,))
    assert set(COMMANDING) <= set(composition.known)
    assert not set(COMMANDING) & set(composition.candidates)
    assert "K_p" in composition.with_asleep(composition.inside, ()).layout.free
    assert set(COMMANDING) <= set(composition.lean(()).layout.types)


@pytest.mark.slow
def test_a_computer_that_is_designed_meets_nothing_of_the_one_that_was_fitted() -> None:
    """Transfer function and simulated loop of a fitted model are those of the plate alone."""
    designed = Ecu(period=5e-3)
    bare, fitted = (loop(*more, ecu=designed) for more in ((), COMMANDING))
    assert_array_equal(np.asarray(bare.linear().a0), np.asarray(fitted.linear().a0))
    paths = [np.asarray(each.respond(one(6.0, 40.0, 0.1), trapezoid()).position) for each in (bare, fitted)]
    assert_allclose(paths[1], paths[0], atol=1e-12)
    assert np.ptp(paths[0]) > 0.3


# ---- folders of the independent generator


BIAS = ((0.0, -20.0), (20.0, -10.0), (30.0, 15.0), (100.0, 30.0))  # % of the travel, % of duty


@pytest.mark.parametrize("told", [True, False])
def test_an_ecu_with_a_bias_table_moves_the_plate_as_the_independent_one(tmp_path: Path, told: bool) -> None:
    """At the truth the free run leaves the sensor's noise, and without the table ten times as much."""
    truth, rng, sigma = draw_truth(np.random.default_rng(4)), np.random.default_rng(5), 1e-3
    ticks = 1e-3 * np.arange(3000)
    wanted = ecu_setpoint(rng, "pedal", ticks, 0.12 * OPEN, 0.85 * OPEN)
    places, duties = np.array(BIAS).T
    ahead = 0.12 * np.interp(100.0 * wanted / OPEN, places, duties)
    angle, _ = helped(throttle(truth, NONE), COMPUTER, wanted, ahead)
    rows = np.column_stack((ticks, angle + sigma * rng.standard_normal(ticks.size), wanted))[::2]
    (tmp_path / "closed_loop").mkdir()
    np.savetxt(tmp_path / "closed_loop" / "1.csv", rows, "%.6f", ",", comments="",
               header="time [s],position [rad],setpoint [rad]")  # fmt: skip
    plate = {s: getattr(truth, s) for s in ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL")}
    fixed = "".join(f"{symbol} = {{ fixed = {value!r} }}\n" for symbol, value in plate.items())
    table = f"bias_percent = {[list(pair) for pair in BIAS]}\n" if told else ""
    (tmp_path / "rig.toml").write_text(
        f'[rig]\nname = "SYNTHETIC"\nsynthetic = true\ngear_ratio = {truth.N}\nsupply_V = 12.0\n'
        f"[noise]\nposition_rad = {sigma}\n[parameters]\n{fixed}{KNOWN}{table}", encoding="utf-8"
    )  # fmt: skip
    rig = read_folder(tmp_path)
    known = free_parameters(rig.config)
    x = known.layout.coordinates({"T_f": truth.T_f, "V_e": 12.0})
    problem = EstimationProblem.of_traces(rig.config, known, ready(rig).fitted).refined(x).with_integrator_states(x)
    left = problem.free_run(x)[0][:, 0] - rows[:, 1]
    rms = float(np.sqrt(np.mean(left**2)))
    assert rms < 1.3 * sigma if told else rms > 10.0 * sigma


@dataclass(frozen=True)
class Case:
    """A folder, what it was made from, and its fit."""

    truth: Truth
    rig: Rig
    result: FitResult


def test_gains_are_read_where_the_bench_has_told_the_plate(tmp_path: Path) -> None:
    _, rig = under_ecu(tmp_path, 4, FREE, problem=True)
    read = read_graphs(rig)
    for symbol, gain in GAINS.items():
        assert read.source[symbol] == "closed_loop"
        assert read.values[symbol] == pytest.approx(gain, rel=0.12)


def without_gains(rig: Rig) -> Readings:
    """What the graphs say, but for the gains of the ECU."""
    read = read_graphs(rig)
    return replace(read, values={s: v for s, v in read.values.items() if s not in ("K_p", "K_i", "K_d")})


def from_afar(truth: Truth, rig: Rig, settings: FitSettings = FitSettings()) -> Case:
    """Fitted with each gain begun 2.5 times off: the reading would begin within a few per cent."""
    far = {"K_p": Start(15.0), "K_i": Start(15.0), "K_d": Start(0.3)}
    rig = replace(rig, config=replace(rig.config, parameters={**rig.config.parameters, **far}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("etcfit.estimation.joint_fit.read_graphs", without_gains)
        return Case(truth, rig, fit(rig, settings=settings))


@pytest.fixture(scope="module")
def beside_the_bench(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return from_afar(*under_ecu(tmp_path_factory.mktemp("rig"), 4, FREE, problem=True))


@pytest.mark.slow
def test_unknown_gains_are_found_with_the_plate(beside_the_bench: Case) -> None:
    """Within four stated standard errors, from a start at which each gain is 2.5 times off."""
    must_be_found(beside_the_bench)


@pytest.mark.slow
def test_unknown_gains_are_found_beside_a_limp_home_spring(tmp_path: Path) -> None:
    """Logs through the default position of a spring that rig.toml names; the generator's has another formula.

    The descents from afar find it: optima beside the one found are looked for in `beside_the_bench`.
    """
    named = FREE + '\n[model]\neffects = ["limp_home_spring"]\n'
    made = under_ecu(tmp_path, 4, named, True, MEDIUM["limp_home_spring"], Log(low=0.03))
    case = from_afar(*made, FitSettings(neighbours=0))
    must_be_found(case)
    at, found = MEDIUM["limp_home_spring"].limp_home_spring.angle, intervals(case.result)["theta_lh"]
    assert abs(found.value - at) < 0.02 * at


def must_be_found(case: Case) -> None:
    """Gains and plate within four stated standard errors, the gains within 1 %, from a start that was far off.

    Of a compromise, which another formula may make of a fit near its data, the range counts as a 95 % interval.
    """
    assert case.result.converged, case.result.reason
    first = case.result.starts[0]
    assert first.chi2_before > 10.0 * sum(row.n for row in case.result.score_fit)
    assert 0.8 < case.result.chi2_per_dof < 1.25
    known = intervals(case.result)
    plate = {s: getattr(case.truth, s) for s in ("R_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")}
    for symbol, value in {**GAINS, **plate}.items():
        found = known[symbol]
        assert found.spread, f"{symbol} has no interval"
        assert abs(found.value - value) < 4.0 * found.spread, symbol
    for symbol, value in GAINS.items():
        assert abs(known[symbol].value / value - 1.0) < 0.01


@pytest.mark.slow
def test_a_log_that_was_held_out_is_predicted(beside_the_bench: Case) -> None:
    held = [row for row in beside_the_bench.result.score_holdout if row.test == "closed_loop"]
    assert [row.channel for row in held] == ["position"]
    assert held[0].rms < 1.2 * held[0].sigma
