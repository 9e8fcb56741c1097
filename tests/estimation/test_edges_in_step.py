"""Edges in step with the samples: found where they are, by the generator that shares no code with the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit.estimation.edges import EdgePlace, common_phase, edge_places, turns, with_edges_in_step
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.ready import ready
from etcfit.estimation.settings import EdgesInStepSettings
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Measurement, Rig
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
    return EstimationProblem.of(rig.config, known, ready(rig).fitted), known.layout.coordinates(values)


def looked(rig: Rig, truth: Truth) -> Rig | None:
    problem, x = at_the_truth(rig, truth)
    clocked = with_edges_in_step(rig, problem, ready(rig).held_out, x, EdgesInStepSettings())
    return None if clocked is None else clocked.rig


@pytest.mark.slow
@pytest.mark.parametrize(("before", "share"), [(0.7, 0.3), (0.95, 0.05), (0.0, 0.0)])
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
    found = common_phase(edges, EdgesInStepSettings())
    assert found is None


@pytest.mark.parametrize("phase", [0.0, 0.4, 0.97])
def test_a_few_edges_that_keep_no_step_do_not_hide_the_others(phase: float) -> None:
    rng = np.random.default_rng(0)
    shares = np.concatenate((phase + 0.02 * rng.standard_normal(18), [0.2, 0.7]))
    found = common_phase([EdgePlace(k, float(s), 0.02) for k, s in enumerate(shares)], EdgesInStepSettings())
    assert found is not None
    assert (found.phase - phase + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.02)
    assert found.chance < 1e-6
    assert -0.15 <= found.phase <= 0.85


def test_a_delay_of_more_than_a_sample_is_no_phase() -> None:
    late = [EdgePlace(k, 1.25, 0.01) for k in range(20)]  # the last place that is looked at
    assert common_phase(late, EdgesInStepSettings()) is None


def test_where_edges_come_with_the_samples_each_has_the_turn_nearest_to_where_it_came() -> None:
    measurement = Measurement("response/1.csv", "response", np.arange(6.0), {})
    places = [EdgePlace(0, 0.97, 0.02), EdgePlace(1, 0.03, 0.02), EdgePlace(2, 0.5, 0.02), EdgePlace(3, 0.6, 0.5)]
    assert_array_equal(turns(measurement, places, -0.02, EdgesInStepSettings()), [1.0, 0.0, np.nan, np.nan, np.nan])


def test_amid_an_interval_an_edge_that_says_nothing_itself_has_the_phase_of_the_others() -> None:
    measurement = Measurement("response/1.csv", "response", np.arange(4.0), {})
    places = [EdgePlace(0, 0.41, 0.02), EdgePlace(1, 0.9, 0.5), EdgePlace(2, 0.9, 0.02)]
    assert_array_equal(turns(measurement, places, 0.4, EdgesInStepSettings()), [0.0, 0.0, np.nan])


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
