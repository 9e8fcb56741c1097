"""Intervals that hold where traces differ by more than their noise, and are left alone where they do not."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import linear_parts as parts
from etcfit.estimation.agreement import Scatter, scatter, widened

REACH = np.ones(parts.P)
LEVEL = 0.05


def one(seed: int, differs: float = 0.0, traces: int = 8) -> tuple[Scatter, np.ndarray, np.ndarray]:
    """Scatter, covariance, and the error of the fit to eight traces whose second coordinate differs by so many sd."""
    rng = np.random.default_rng(seed)
    every = parts.jacobians(rng, 40, {"alpha": traces})
    J = np.vstack(list(every.values()))
    covariance = np.linalg.inv(J.T @ J)
    r = parts.residuals(rng, every)
    for key, own in every.items():
        r[key] -= own[:, 1] * differs * np.sqrt(traces * covariance[1, 1]) * rng.standard_normal()
    x = parts.optimum(every, r)
    said = list(parts.said(parts.pieces(every, r, x)).values())
    return scatter(said, parts.nothing_believed(), REACH, 10.0), covariance, x


def test_shifts_are_those_of_the_jackknife() -> None:
    rng = np.random.default_rng(5)
    every = parts.jacobians(rng)
    r = parts.residuals(rng, every)
    x = parts.optimum(every, r)
    found = scatter(list(parts.said(parts.pieces(every, r, x)).values()), parts.nothing_believed(), REACH, 10.0)
    for shift, (test, file) in zip(found.shifts, every, strict=True):
        assert_allclose(shift, parts.optimum(parts.without(every, test, file), r) - x, rtol=1e-6, atol=1e-10)


def test_where_traces_agree_the_test_rejects_as_often_as_it_says() -> None:
    p = np.array([one(seed)[0].p for seed in range(300)])
    assert 0.02 < np.mean(p < LEVEL) < 0.08
    assert stats.kstest(p[:, 0], "uniform").pvalue > 1e-3


def test_where_traces_agree_few_intervals_grow_and_none_shrinks() -> None:
    grown = []
    for seed in range(100):
        found, covariance, _ = one(seed)
        wide = widened(covariance, [found], LEVEL)
        assert np.linalg.eigvalsh(wide - covariance).min() > -1e-12  # nor does that of any combination
        grown.append(np.sqrt(np.diag(wide) / np.diag(covariance)))
    assert np.median(grown) == 1.0
    assert np.mean(grown) < 1.3


def test_where_traces_differ_intervals_hold_that_did_not() -> None:
    inside, before = [], []
    for seed in range(300):
        found, covariance, error = one(seed, differs=4.0)
        wide = widened(covariance, [found], LEVEL)
        inside.append(abs(error[1]) < 1.96 * np.sqrt(wide[1, 1]))
        before.append(abs(error[1]) < 1.96 * np.sqrt(covariance[1, 1]))
    assert np.mean(before) < 0.6
    assert 0.92 < np.mean(inside) <= 0.99


def test_the_covariance_is_that_of_the_formula() -> None:
    found, covariance, _ = one(0, differs=20.0)
    assert found.p[1] < LEVEL
    freedom = 1.0 + found.freedom[1]
    phi = (1.0 + found.freedom[1] * found.ratio[1]) / freedom
    wanted = phi * (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2 * covariance[1, 1]
    assert widened(covariance, [found], LEVEL)[1, 1] == pytest.approx(wanted)


def test_two_clusters_of_which_one_alone_tells_a_coordinate_say_nothing_of_it() -> None:
    rng = np.random.default_rng(2)
    every = parts.jacobians(rng, 40, {"alpha": 1, "beta": 1})
    every["beta", "beta/0.csv"][:, 2] = 0.0
    r = parts.residuals(rng, every, {"alpha": np.array([0.0, 3.0, 3.0])})
    said = list(parts.said(parts.pieces(every, r, parts.optimum(every, r))).values())
    assert reduce(add, said).samples == 80.0
    found = scatter(said, parts.nothing_believed(), REACH, 0.3)
    assert found.ratio[2] == 0.0
    assert found.p[2] == 1.0
    assert found.p[1] < 1e-6
