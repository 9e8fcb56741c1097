"""Amplitudes within their bounds, against the search over which of them rest at a bound."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.screen import bounded, lowest
from etcfit.model.parameters import NonNegative, Positive, Real

LOW = np.array([0.0, -np.inf, 0.0, 0.0])


def test_only_what_cannot_be_negative_has_a_bound() -> None:
    assert lowest([NonNegative(1.0), Real(2.0), Positive(1.0)]).tolist() == [0.0, -np.inf, -np.inf]


@pytest.mark.parametrize("seed", range(8))
def test_no_other_choice_of_amplitudes_at_rest_fits_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, target = rng.normal(size=(30, 4)), rng.normal(size=30)
    columns /= np.linalg.norm(columns, axis=0)
    found = bounded(columns, target, LOW)
    assert np.all(found >= LOW)
    best = np.inf
    for at_work in itertools.product((False, True), repeat=4):
        some = np.flatnonzero(at_work)
        a = np.zeros(4)
        a[some] = np.linalg.lstsq(columns[:, some], target, rcond=None)[0]
        if np.all(a >= LOW):
            best = min(best, float(np.sum((columns @ a - target) ** 2)))
    assert_allclose(np.sum((columns @ found - target) ** 2), best, rtol=1e-8)


def test_of_two_that_do_the_same_both_stay_small() -> None:
    column = np.ones((9, 1)) / 3.0
    found = bounded(np.hstack((column, column)), 2.0 * column[:, 0], np.array([-np.inf, -np.inf]))
    assert_allclose(found, 1.0, rtol=1e-5)
