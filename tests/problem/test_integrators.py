"""The voltage in the integral of an ECU in the model: what is not simulated changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from benchmarks.bank import under_ecu as bank
from etcfit.problem.batch import batch_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.reader import read_folder
from independent import draw_truth
from measurements import measurement

HALVINGS = (3.0, 1.5, 0.7, 0.3, 0.15, 0.07, 0.03, 0.015, 0.007, 0.003)  # V


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> EstimationProblem:
    """Steps and ramps under an ECU, and behind them a trace that a logged voltage drives."""
    folder = tmp_path_factory.mktemp("rig")
    bank.write(folder, draw_truth(np.random.default_rng(17003)), 17003, "known")
    rig = read_folder(folder)
    time = 2e-3 * np.arange(60)
    driven = measurement("response", time, {"voltage": 2.0 + 0.0 * time, "position": 0.3 + time})
    traces = [prepare(m, rig.config) for m in (driven, *rig.measurements)]
    return EstimationProblem.of_traces(
        rig.config, free_parameters(rig.config), tuple(t for t in traces if t is not None)
    )


@pytest.fixture(scope="module")
def x(problem: EstimationProblem) -> np.ndarray:
    layout = problem.layout
    values = layout.values(np.zeros(len(layout.free)), problem.free_parameters.held)
    return layout.coordinates({**values, **{p.symbol: p.nominal for p in layout.parameters}})


def searched(problem: EstimationProblem, x: np.ndarray) -> np.ndarray:
    """The voltages found by whole free runs of all traces, one after the other."""
    controlled = np.array([trace.controlled for trace in problem.batch.traces])
    volts = np.zeros(controlled.size)

    def misfit(tried: np.ndarray) -> np.ndarray:
        paths = replace(problem, batch=problem.batch.holding(tried)).free_run(x)
        out = []
        for trace, path in zip(problem.batch.traces, paths, strict=True):
            error = (trace.data - path)[:, 0] / trace.sigma[0]
            moved = np.abs(trace.data[:, 0] - trace.data[0, 0]) > 8.0 * trace.sigma[0]
            out.append(np.nansum(error[trace.instants < trace.instants[np.argmax(moved)] + 1.0] ** 2))
        return np.array(out)

    for span in HALVINGS:
        tried = [volts + controlled * side * span for side in (0.0, -1.0, 1.0)]
        volts = np.choose(np.argmin([misfit(each) for each in tried], axis=0), tried)
    return volts


@pytest.mark.slow
def test_the_beginnings_of_the_traces_concerned_tell_what_whole_free_runs_do(
    problem: EstimationProblem, x: np.ndarray
) -> None:
    found = problem.with_integrator_states(x).batch.traces
    wanted = searched(problem, x)
    for trace, volts in zip(found, wanted, strict=True):
        assert trace.input is not None
        if trace.controlled:
            assert trace.input.value[0] == pytest.approx(volts, abs=1e-12)
            assert volts != 0.0  # it went somewhere
    assert found[0] is problem.batch.traces[0]


def test_a_jump_seen_at_another_instant_lies_as_in_a_new_batch_and_the_rest_is_not_copied(
    problem: EstimationProblem,
) -> None:
    batch = problem.batch
    traces = tuple(trace.with_jumps_at(0.9) for trace in batch.traces)
    found = batch.with_times_of(traces, problem.config, problem.substeps)
    wanted = batch_of(traces, problem.config, problem.substeps)
    for (*_, marks), (*_, anew) in zip(found.places, wanted.places, strict=True):
        assert_array_equal(marks, anew)
    for part in ("resets", "slots", "disturbance"):
        for one, other in zip(getattr(found, part), getattr(wanted, part), strict=True):
            assert_array_equal(one, other)
    assert found.steps.command is not None
    assert wanted.steps.command is not None
    for one, other in zip(
        (*found.steps.command, found.steps.dt), (*wanted.steps.command, wanted.steps.dt), strict=True
    ):
        assert_array_equal(one, other)
    assert not np.array_equal(found.steps.dt, batch.steps.dt)
    assert found.slots.kind is batch.slots.kind
