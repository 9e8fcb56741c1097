"""Edges in step with the samples: found where they are, by the generator that shares no code with the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from benchmarks.bank import cases
from etcfit.estimation.edges import (
    Decided,
    EdgePlace,
    accepts,
    common_phase,
    edge_places,
    phases_hold,
    turns,
    with_edges_in_step,
    with_edges_on_samples,
)
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.levenberg_marquardt import minimise
from etcfit.estimation.ready import ready
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached
from etcfit.model.rig_effects import EdgePhase, Place
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.base import Channel, Fixed, Measurement, Rig, RigConfig
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, Truth, draw_truth, make_folder
from independent.instruments import Bench

SEED, SERIES = 7321, 1.218
TESTS = {"inductance", "viscous", "response"}


def made(folder: Path, edge_phase: float | None) -> tuple[Rig, Truth]:
    truth = draw_truth(np.random.default_rng(SEED), CONSISTENT)
    make_folder(folder, truth, SEED, size="twin", bench=replace(Bench(), edge_phase=edge_phase))
    return read_folder(folder), truth


def at_the_truth(rig: Rig, truth: Truth) -> tuple[EstimationProblem, np.ndarray]:
    known = free_parameters(rig.config)
    values = {s: float(getattr(truth, s, SERIES)) for s in known.layout.free}
    return EstimationProblem.of_traces(rig.config, known, ready(rig).fitted), known.layout.coordinates(values)


def looked(rig: Rig, truth: Truth) -> Rig | None:
    problem, x = at_the_truth(rig, truth)
    clocked = with_edges_in_step(rig, problem, ready(rig).held_out, x)
    return None if clocked is None else clocked.rig


@pytest.mark.slow
@pytest.mark.parametrize(("before", "share"), [(0.95, 0.05), (0.0, 0.0)])
def test_the_phase_of_each_test_and_the_turn_of_each_edge(tmp_path: Path, before: float, share: float) -> None:
    rig, truth = made(tmp_path, before)
    clocked = looked(rig, truth)
    assert clocked is not None
    phases = {s: k for s, k in clocked.config.parameters.items() if s.startswith("edge_phase")}
    assert {s.removeprefix("edge_phase.") for s in phases} <= TESTS
    assert abs(phases["edge_phase.response"].value - share) < 0.05  # pyright: ignore[reportAttributeAccessIssue]
    turns = np.concatenate(
        [m.edge_turn for m in clocked.measurements if m.test == "response" and m.edge_turn is not None]
    )
    turns = turns[np.isfinite(turns)]
    assert turns.size > 10
    # where edges come with the samples, the clock's jitter shows about half of them one sample later
    assert (turns == 0.0).all() if share else 0.2 < turns.mean() < 0.8


@pytest.mark.slow
def test_edges_at_any_instant_are_left_as_they_are(tmp_path: Path) -> None:
    rig, truth = made(tmp_path, None)
    assert looked(rig, truth) is None
    places = edge_places(*at_the_truth(rig, truth))
    edges = [p for file, each in places.items() if file.startswith("response/") for p in each]
    assert np.ptp([p.share for p in edges if p.sd < 0.1]) > 0.7
    found = common_phase(edges)
    assert found is None


@pytest.mark.parametrize("phase", [0.0, 0.4, 0.97])
def test_a_few_edges_that_keep_no_step_do_not_hide_the_others(phase: float) -> None:
    rng = np.random.default_rng(0)
    shares = np.concatenate((phase + 0.02 * rng.standard_normal(18), [0.2, 0.7]))
    found = common_phase([EdgePlace(k, float(s), 0.02) for k, s in enumerate(shares)])
    assert found is not None
    assert (found.phase - phase + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.02)
    assert found.chance < 1e-6
    assert -0.15 <= found.phase <= 0.85


def test_a_delay_of_more_than_a_sample_is_no_phase() -> None:
    late = [EdgePlace(k, 1.25, 0.01) for k in range(20)]  # the last place that is looked at
    assert common_phase(late) is None


def test_where_edges_come_with_the_samples_each_has_the_turn_nearest_to_where_it_came() -> None:
    measurement = Measurement("response/1.csv", "response", np.arange(6.0), {})
    places = [EdgePlace(0, 0.97, 0.02), EdgePlace(1, 0.03, 0.02), EdgePlace(2, 0.5, 0.02), EdgePlace(3, 0.6, 0.5)]
    assert_array_equal(turns(measurement, places, -0.02), [1.0, 0.0, np.nan, np.nan, np.nan])


def test_amid_an_interval_an_edge_that_says_nothing_itself_has_the_phase_of_the_others() -> None:
    measurement = Measurement("response/1.csv", "response", np.arange(4.0), {})
    places = [EdgePlace(0, 0.41, 0.02), EdgePlace(1, 0.9, 0.5), EdgePlace(2, 0.9, 0.02)]
    assert_array_equal(turns(measurement, places, 0.4), [0.0, 0.0, np.nan])


@pytest.mark.slow
def test_a_fit_of_edges_in_step_finds_their_phases(tmp_path: Path) -> None:
    rig, truth = made(tmp_path, 0.9)
    result = fit(rig)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    assert result.values["edge_phase.response"] == pytest.approx(0.1, abs=0.02)
    assert result.values["edge_phase.viscous"] == pytest.approx(0.1, abs=0.02)
    found = intervals(result)["L_a"]
    assert found.status == "estimated"
    assert found.stderr is not None
    assert found.stderr < 0.01 * truth.L_a
    assert abs(found.value - truth.L_a) < 3.0 * found.stderr


# ---- Edges exactly on the samples: decided for each test by likelihood, on circuits whose exact current is known

R, L, DT, EVERY, EDGES, SIGMA = 2.0, 1e-3, 2e-4, 25, 8, 2e-3  # ohm, H, s, samples, -, A
SHARP, WEAK = "inductance", "resistance"


def circuit(test: str, before: float, turn: float, sigma: float) -> Measurement:
    """A held plate between 1 and 3 V, each edge so many sample intervals before the end of its interval."""
    time = DT * np.arange(EVERY * (EDGES + 1))
    volts, current = np.full(time.size, 1.0), np.full(time.size, 1.0 / R)
    turns = np.full(time.size - 1, np.nan)
    for k in range(1, EDGES + 1):
        jump, since = 2.0 * (-1.0) ** (k - 1), time - DT * (EVERY * k - before)
        volts = volts + jump * (np.arange(time.size) >= EVERY * k)
        current = current + jump / R * (1.0 - np.exp(-np.maximum(since, 0.0) * R / L))
        turns[EVERY * k - 1] = turn
    noisy = current + sigma * np.random.default_rng(3).standard_normal(time.size)
    channels = {"voltage": Channel(time, volts, 1e-3, True, "voltage", "V", 1.0),
                "current": Channel(time, noisy, sigma, True, "current", "A", 1.0)}  # fmt: skip
    return Measurement(f"{test}/1.csv", test, time, channels, edge_turn=turns)


def reached(*measurements: Measurement) -> tuple[Rig, Reached]:
    """A fit of the phases alone, every one of them from 0.03 of an interval before the sample."""
    effects = tuple(EdgePhase.at(Place(m.test)).name for m in measurements)
    known = {"R_a": Fixed(R), "L_a": Fixed(L), "K_b": Fixed(0.03)}
    config = RigConfig("by hand", effects=effects, parameters=known)
    rig = Rig("by hand", config, measurements)
    chosen = free_parameters(config)
    traces = tuple(t for t in (prepare(m, config) for m in measurements) if t is not None)
    x = chosen.layout.coordinates({s: chosen.layout.parameter(s).nominal for s in chosen.layout.free})
    for m in measurements:
        assert m.edge_turn is not None
        x[chosen.layout.free.index(f"edge_phase.{m.test}")] = -0.03 if np.nanmax(m.edge_turn) > 0.5 else 0.03
    problem = EstimationProblem.of_traces(config, chosen, traces).refined(x)
    weighted = problem.weighted(problem.kalman(x))
    x, _ = minimise(problem, x, weighted, 1e-6)
    return rig, Reached(problem, weighted, x, Termination(True, ""))


def decided(*measurements: Measurement, places: dict[str, tuple[EdgePlace, ...]] | None = None) -> Decided | None:
    return with_edges_on_samples(*reached(*measurements), places or {})


def phase_of(found: Decided | None, test: str = SHARP) -> float | None:
    known = None if found is None else found.rig.config.parameters.get(f"edge_phase.{test}")
    return known.value if isinstance(known, Fixed) else None


# exactly, and 0.2 us before it in an interval of 1 ms; the same where the sample does not show the edge yet
@pytest.mark.parametrize(("before", "turn"), [(0.0, 1.0), (2e-4, 1.0), (1.0, 0.0), (0.9998, 0.0)])
def test_an_edge_on_its_sample_has_no_free_phase(before: float, turn: float) -> None:
    assert phase_of(decided(circuit(SHARP, before, turn, SIGMA))) == 0.0


@pytest.mark.parametrize(("before", "turn"), [(0.02, 1.0), (0.1, 1.0), (0.98, 0.0), (0.9, 0.0)])
def test_an_edge_between_two_samples_is_left_as_it_was_fitted(before: float, turn: float) -> None:
    assert decided(circuit(SHARP, before, turn, SIGMA)) is None


def test_a_descent_that_left_the_interval_is_sent_back_into_it() -> None:
    rig, end = reached(circuit(SHARP, 0.05, 1.0, SIGMA))
    at = end.problem.layout.free.index("edge_phase.inductance")
    beyond = end.x.copy()
    beyond[at] = 0.04
    found = with_edges_on_samples(rig, end._replace(x=beyond), {})
    assert found is not None
    assert phase_of(found) is None
    assert found.x[at] == pytest.approx(-0.05, abs=0.02)


def test_a_phase_that_ran_away_places_no_edge() -> None:
    _, end = reached(circuit(SHARP, 0.05, 1.0, SIGMA), circuit(WEAK, 0.05, 1.0, SIGMA))
    beyond, k = end.x.copy(), end.problem.layout.free.index("edge_phase.inductance")
    for phase, holds in ((-0.9, True), (1.1, True), (13.7, False), (-8.5, False)):
        beyond[k] = phase
        assert phases_hold(end.problem, beyond) == holds


@pytest.mark.slow
def test_a_model_that_lacks_a_slow_sensor_leaves_edges_where_they_are(tmp_path: Path) -> None:
    """They lie on the samples; without the sensor's lag the phases ran away to 13.7 and -8.5 intervals."""
    cases.made(cases.chosen("edges", 8304, 1)[0], tmp_path)
    rig = read_folder(tmp_path)
    without = fit(rig)
    assert not any(effect.startswith(EdgePhase.kind) for effect in without.rig.config.effects)
    known = fit(replace(rig, config=replace(rig.config, effects=("position_sensor_lag", "gravity_load"))))
    assert known.values["edge_phase.response"] == 0.0
    assert known.chi2_per_dof == pytest.approx(1.0, abs=0.03)


def test_one_clock_drives_all_tests() -> None:
    """A test whose phase tells little is decided with one that is sharp, its uncertain edges too, and not alone."""
    sharp, weak = circuit(SHARP, 0.0, 1.0, SIGMA), circuit(WEAK, 0.0, 1.0, 60 * SIGMA)
    places = {f"{WEAK}/1.csv": tuple(EdgePlace(EVERY * k - 1, 0.9, 0.5) for k in range(1, EDGES + 1))}
    lost = replace(weak, edge_turn=np.where(np.arange(weak.time.size - 1) == EVERY - 1, 1.0, np.nan))
    found = decided(sharp, lost, places=places)
    assert (phase_of(found), phase_of(found, WEAK)) == (0.0, 0.0)
    assert found is not None
    (turned,) = (m.edge_turn for m in found.rig.measurements if m.test == WEAK)
    assert turned is not None
    assert_array_equal(np.flatnonzero(turned == 1.0), EVERY * np.arange(1, EDGES + 1) - 1)


def test_weak_edges_tell_together_where_they_are_not() -> None:
    many = [EdgePlace(k, 0.5, 0.4) for k in range(12)]
    assert accepts(many[:2], 1.0)
    assert not accepts(many, 1.0)
    assert not accepts([EdgePlace(0, 0.8, 0.01)], 1.0)
    assert accepts([EdgePlace(0, 0.99, 0.01), EdgePlace(1, -0.2, np.inf)], 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "lead"), [(7951, 2e-6), (7914, 0.0)])
def test_a_fit_of_edges_on_the_samples(tmp_path: Path, seed: int, lead: float) -> None:
    """With edges enough to prove the clock: those of seed 7951 and a lead of 0 are too few."""
    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    make_folder(tmp_path, truth, seed, size="diagnose", bench=replace(Bench(), jitter=0.0, edge_lead=lead))
    result = fit(read_folder(tmp_path))
    phases = {s for s in result.values if s.startswith("edge_phase")}
    assert {f"edge_phase.{t}" for t in ("inductance", "viscous", "response")} <= phases
    assert not phases & {*result.free_parameters.layout.free}
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.05)
    for symbol, found in intervals(result).items():
        if found.status == "estimated" and hasattr(truth, symbol):
            assert found.stderr is not None
            assert abs(found.value - getattr(truth, symbol)) < 3.0 * found.stderr, symbol
