"""Edges exactly on the samples: decided for each test by likelihood, on circuits whose exact current is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit.estimation.edges import Decided, EdgePlace, accepts, with_edges_on_samples
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.levenberg_marquardt import minimise
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached
from etcfit.estimation.settings import EdgesInStepSettings
from etcfit.model.rig_effects import EdgePhase, Place
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.base import Channel, Fixed, Measurement, Rig, RigConfig
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, draw_truth, make_folder
from independent.instruments import Bench

R, L, DT, EVERY, EDGES, SIGMA = 2.0, 1e-3, 2e-4, 25, 8, 2e-3  # ohm, H, s, samples, -, A
SHARP, WEAK = "inductance", "resistance"
USUAL = EdgesInStepSettings()


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
    problem = EstimationProblem.of(config, chosen, traces).refined(x)
    weighted = problem.weighted(problem.kalman(x))
    x, _ = minimise(problem, x, weighted, 1e-6)
    return rig, Reached(problem, weighted, x, Termination(True, ""))


def decided(*measurements: Measurement, places: dict[str, tuple[EdgePlace, ...]] | None = None) -> Decided | None:
    return with_edges_on_samples(*reached(*measurements), places or {}, USUAL)


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
    found = with_edges_on_samples(rig, end._replace(x=beyond), {}, USUAL)
    assert found is not None
    assert phase_of(found) is None
    assert found.x[at] == pytest.approx(-0.05, abs=0.02)


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
    assert accepts(many[:2], 1.0, USUAL)
    assert not accepts(many, 1.0, USUAL)
    assert not accepts([EdgePlace(0, 0.8, 0.01)], 1.0, USUAL)
    assert accepts([EdgePlace(0, 0.99, 0.01), EdgePlace(1, -0.2, np.inf)], 1.0, USUAL)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "lead"), [(7951, 1e-9), (7951, 2e-7), (7951, 2e-6), (7914, 0.0)])
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
