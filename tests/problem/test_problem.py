"""EstimationProblem: what each method changes, and what it leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.prediction_error import columns
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Fixed, Prior
from measurements import CONFIG, N, measurement, prepared, released

T = np.arange(6) * 1e-3


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    trace = prepared(measurement("response", T, {"voltage": 0 * T, "position": 0 * T + 0.3}))
    made = EstimationProblem.of_traces(CONFIG, free_parameters(CONFIG), (trace,))
    return replace(made, jitter=0.1, guide_stiffness=3.0, sigma=2.0 * made.sigma)


def test_other_parameters_leave_data_weights_jitter_and_guide(problem: EstimationProblem) -> None:
    other = free_parameters(replace(CONFIG, parameters={"K_s": Fixed(0.2)}))
    changed = problem.with_parameters(other)
    assert changed.free_parameters is other
    for name in ("config", "batch", "substeps", "sigma", "jitter", "guide_stiffness"):
        assert getattr(changed, name) is getattr(problem, name)


def test_without_a_release_or_an_ecu_there_is_nothing_to_move(problem: EstimationProblem) -> None:
    x = np.zeros(len(problem.layout.free))
    assert problem.with_release_times(x) is problem
    assert problem.with_integrator_states(x) is problem


def test_a_guide_changes_the_guide_alone(problem: EstimationProblem) -> None:
    changed = problem.guided(0.0)
    assert changed.guide_stiffness == 0.0
    assert changed.sigma is problem.sigma
    assert changed.batch is problem.batch


def test_compiled_functions_see_the_noise_with_outliers_weighed_down(problem: EstimationProblem) -> None:
    assert problem.arrays().slots.sigma is problem.sigma
    assert_allclose(columns(problem.batch, problem.slots.sigma)[0], 2.0 * problem.batch.traces[0].sigma[0])


def test_priors_become_priors_on_coordinates() -> None:
    """x = value / scale for a real parameter: sd_x = sd / scale; without a prior sd is infinite."""
    known = free_parameters(replace(CONFIG, parameters={"T_PL": Prior(0.3, 0.02)}))
    mean, sd = known.priors_on_coordinates
    k = known.layout.free.index("T_PL")
    scale = known.layout.parameter("T_PL").domain.scale
    assert_allclose([mean[k], sd[k]], [0.3 / scale, 0.02 / scale])
    assert np.isinf(np.delete(sd, k)).all()


@pytest.mark.slow
def test_prepared_again_it_is_as_it_was_logged_with_the_steps_that_x_needs() -> None:
    """A poorer model moved the release by 20 ms, weighed samples down, drew the plate along and took three steps."""
    motion = released(0.05)
    values = {"emf": N * 0.0189 * motion.speed, "position": motion.angle}
    logged = prepared(measurement("back_emf", motion.time, values))
    assert logged.release is not None
    known = free_parameters(CONFIG)
    light = {"J_m": 0.03, "J_L": 0.03}  # times nominal: a plate so fast that one step is not enough
    x = known.layout.coordinates({p.symbol: p.nominal * light.get(p.symbol, 1.0) for p in known.layout.parameters})
    moved = logged.released_at(logged.release[0] + 0.02, 0.1 * logged.release[1])
    poor = EstimationProblem.of_traces(CONFIG, known, (moved,), [np.full(moved.instants.size - 1, 3)], (2048, 1, 2))
    poor = replace(poor, jitter=0.1, guide_stiffness=3.0, sigma=2.0 * poor.sigma)
    again = poor.reprepared(x)
    (trace,) = again.batch.traces
    assert trace.release == logged.release
    assert (again.jitter, again.guide_stiffness) == (0.1, 0.0)
    assert_allclose(columns(again.batch, again.sigma)[0], columns(poor.batch, poor.sigma)[0] / 2.0)
    (needed,) = EstimationProblem.of_traces(CONFIG, known, (logged,)).refined(x).substeps
    assert set(needed.tolist()) > {1}
    assert_array_equal(again.substeps[0], needed)
    assert again.room == poor.room
