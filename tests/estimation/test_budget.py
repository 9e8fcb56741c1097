"""Which source makes which share of a variance."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from etcfit.estimation.result import Budget


def test_shares_are_those_of_the_variance_and_sum_to_one() -> None:
    moves = np.array([[3.0, 0.0], [0.0, 0.5]])  # one standard deviation of each source, in coordinates
    found = Budget(("scale of current", "gear ratio"), moves, np.diag([16.0, 0.75])).shares()
    assert_allclose(found, [[9.0 / 25.0, 0.0], [0.0, 0.25], [16.0 / 25.0, 0.75]])
    assert_allclose(found.sum(axis=0), 1.0)


def test_a_parameter_without_any_variance_has_no_shares() -> None:
    assert_allclose(Budget(("gear ratio",), np.zeros((1, 1)), np.zeros((1, 1))).shares(), 0.0)
