"""Steps in each interval: the cube root of the error over the tolerance, no fewer than one."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from etcfit.problem.batch import batch_of
from etcfit.problem.substeps import TOLERANCE, substeps_needed
from etcfit.problem.trace import prepare
from measurements import CONFIG, measurement

T = np.arange(6) * 1e-3


def test_an_interval_gets_the_steps_that_its_worst_error_asks_for() -> None:
    """An error of third order in the step: 8 tolerances need twice the steps, less than one needs one."""
    trace = prepare(measurement("response", T, {"voltage": 0 * T, "position": 0 * T + 0.3}), CONFIG)
    assert trace is not None
    batch = batch_of([trace], CONFIG, [np.array([1, 2, 1, 1, 1])])
    lane, _, marks = batch.places[0]
    error = np.zeros(batch.steps.dt.shape)
    error[marks[1:], lane] = TOLERANCE * np.array([7.9, 7.9, 0.0, np.inf, 1e9])
    error[marks[1] + 1, lane] = TOLERANCE * 0.5  # the first of two steps of the second interval is the better one
    (steps,) = substeps_needed(batch, error)
    assert_array_equal(steps, [2, 4, 1, 24, 24])
