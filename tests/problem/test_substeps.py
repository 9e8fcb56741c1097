"""Steps in each interval: the cube root of the error over the tolerance, no fewer than one; and that error itself."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from etcfit.problem.batch import batch_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import run
from etcfit.problem.substeps import TOLERANCE, local_error, substeps_needed
from etcfit.rig.base import Fixed
from measurements import CONFIG, SIGMA, measurement, prepared

T = np.arange(6) * 1e-3


def test_an_interval_gets_the_steps_that_its_worst_error_asks_for() -> None:
    """An error of third order in the step: 8 tolerances need twice the steps, less than one needs one."""
    trace = prepared(measurement("response", T, {"voltage": 0 * T, "position": 0 * T + 0.3}))
    batch = batch_of([trace], CONFIG, [np.array([1, 2, 1, 1, 1])])
    lane, _, marks = batch.places[0]
    error = np.zeros(batch.steps.dt.shape)
    error[marks[1:], lane] = TOLERANCE * np.array([7.9, 7.9, 0.0, np.inf, 1e9])
    error[marks[1] + 1, lane] = TOLERANCE * 0.5  # the first of two steps of the second interval is the better one
    (steps,) = substeps_needed(batch, error)
    assert_array_equal(steps, [2, 4, 1, 24, 24])


# ---- the error of a held plate's current, by its closed form

VALUES = bodies.values()
VOLTS, SHARE = 12.0, 0.2  # of the time constant, between samples


@pytest.fixture(scope="module")
def charging() -> tuple[EstimationProblem, np.ndarray]:
    """A coil without current at a constant voltage, logged five times in its time constant; and the coordinates."""
    t = np.arange(50) * SHARE * VALUES["L_a"] / VALUES["R_a"]
    current = VOLTS / VALUES["R_a"] * (1.0 - np.exp(-t * VALUES["R_a"] / VALUES["L_a"]))
    trace = prepared(measurement("resistance", t, {"voltage": 0 * t + VOLTS, "current": current}))
    held = {s: Fixed(v) for s, v in VALUES.items() if s not in ("R_a", "L_a", "K_m")}
    known = free_parameters(replace(CONFIG, parameters=held))
    return EstimationProblem.of_traces(CONFIG, known, (trace,)), known.layout.coordinates(VALUES)


def errors(problem: EstimationProblem, x: np.ndarray) -> np.ndarray:
    """Local error of every step of the one trace, shape (rows,)."""

    form, padded, pick = problem.at(x)

    @jax.jit
    def error(x: jax.Array) -> jax.Array:
        throttle, path, steps, resets = run(form, x, pick, problem.arrays())
        return local_error(throttle, path, problem.arrays()._replace(steps=steps, resets=resets))

    lane, row, marks = problem.batch.places[0]
    return np.asarray(error(jnp.asarray(padded)))[row + 1 : marks[-1] + 1, lane]


@pytest.mark.slow
def test_the_local_error_is_that_of_the_closed_form(charging: tuple[EstimationProblem, np.ndarray]) -> None:
    """A step of third-order error e is off its two halves by e - 2 e / 8: three quarters of what it is truly off by."""
    problem, x = charging
    current = problem.free_run(x)[0][:, 0]
    end, decay = VOLTS / VALUES["R_a"], np.exp(-SHARE)
    truly = np.abs(current[1:] - (end + (current[:-1] - end) * decay)) / SIGMA["current"]
    assert truly[0] > 10.0 * TOLERANCE
    assert_allclose(errors(problem, x), 0.75 * truly, rtol=0.05, atol=1e-3 * truly[0])


@pytest.mark.slow
def test_with_the_steps_that_are_needed_it_is_within_the_tolerance(
    charging: tuple[EstimationProblem, np.ndarray],
) -> None:
    problem, x = charging
    refined = problem.refined(x)
    assert max(refined.substeps[0]) > 1
    assert np.max(errors(refined, x)) <= TOLERANCE
    fewer = EstimationProblem.of_traces(
        CONFIG, problem.free_parameters, problem.batch.traces, [np.maximum(refined.substeps[0] - 1, 1)]
    )
    assert np.max(errors(fewer, x)) > TOLERANCE
