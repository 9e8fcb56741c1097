"""THE residual: noise of its own at the truth, and the rows of the priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.prediction_error import columns
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Fixed, Prior
from measurements import CONFIG, SIGMA, measurement, prepared

T = np.arange(400) * 1e-3
SYMBOLS = {"R_a": 1.5, "L_a": 1.5e-3, "K_b": 0.02, "J_m": 1e-6, "J_L": 6e-4, "B_m": 2e-5, "B_L": 1e-3}
VALUES = SYMBOLS | {"K_s": 0.15, "T_PL": 0.36, "T_f": 0.2}


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    """A held plate at a constant 3 V, its current settled: 2 A and white noise; R_a is free, with a prior."""
    noise = np.random.default_rng(3).standard_normal(T.size)
    values = {"voltage": 0 * T + 3.0, "current": 2.0 + SIGMA["current"] * noise}
    trace = prepared(measurement("resistance", T, values))
    trace = replace(trace, start=replace(trace.start, state=(2.0, 0.0, 0.0)))
    known = {s: Fixed(v) for s, v in VALUES.items() if s != "R_a"} | {"R_a": Prior(1.5, 0.15)}
    config = replace(CONFIG, parameters=known)
    return EstimationProblem.of_traces(config, free_parameters(config), (trace,))


def test_at_the_truth_it_is_the_noise_and_off_it_what_ohms_law_says(problem: EstimationProblem) -> None:
    weighted = problem.weighted(weights.free_running(problem))
    noise = np.random.default_rng(3).standard_normal(T.size)
    at = {R: problem.layout.coordinates(VALUES | {"R_a": R}) for R in (1.5, 2.0)}
    (r,) = columns(problem.batch, problem.residual(at[1.5], weighted))
    assert_allclose(r[:, 0], noise, atol=1e-6)
    (r,) = columns(problem.batch, problem.residual(at[2.0], weighted))
    assert_allclose(r[100:, 0], noise[100:] + 0.5 / SIGMA["current"], atol=1e-6)  # 3 V / 2 ohm, 0.5 A too little


def test_a_prior_is_a_row_of_its_own_in_standard_deviations(problem: EstimationProblem) -> None:
    """R_a = scale exp(x): a prior of 10 % is one of 0.1 on x."""
    weighted = problem.weighted(weights.free_running(problem))
    x = problem.layout.coordinates(VALUES)
    prior = problem.linearise(x + 0.2, weighted).prior
    assert prior.shape == x.shape
    assert_allclose(prior, [2.0], rtol=1e-3)
