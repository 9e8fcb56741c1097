"""The range that subsets of the data give, and who it concerns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import results
from etcfit.estimation.agreement import Compromise, compromise_reason
from etcfit.estimation.intervals import intervals, lumped
from etcfit.estimation.joint_fit import FitResult
from etcfit.estimation.settings import FitSettings


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")))


def subsets(x: np.ndarray, moves: dict[int, float]) -> Compromise:
    """One test left out moves some coordinates, one test alone says the same as all."""
    point = x.copy()
    for k, step in moves.items():
        point[k] += step
    covariance = 0.01**2 * np.eye(x.size)
    return Compromise("why", ("one",), point[None], covariance[None], np.full((1, x.size), np.nan))


def test_a_range_holds_the_interval_stated_and_what_each_subset_says() -> None:
    found = Compromise(
        "why", ("a", "b"), np.array([[1.0, 0.0], [-1.0, 5.0]]),
        np.array([np.diag([0.01, 0.01]), np.diag([0.04, 9.0])]), np.array([[3.0, np.nan]]),
    )  # fmt: skip
    low, high = found.ends(2.0, np.array([-0.5, -0.5]), np.array([0.5, 0.5]), np.array([1.0, 1.0]))
    assert_allclose(low, [-1.0 - 2.0 * 0.2, -0.5])
    assert_allclose(high, [3.0, 0.5])  # of the second, one subset says 0 and the other does not know it


def test_far_from_the_data_nothing_is_estimated(fitted: FitResult) -> None:
    k = fitted.free_parameters.layout.free.index("R_a")
    every = intervals(replace(fitted, compromise=subsets(fitted.x, {k: 0.5})))
    assert {i.status for i in every.values()} == {"compromise", "fixed"}
    was = intervals(fitted)["R_a"]
    assert every["R_a"].stderr is None
    assert every["R_a"].low == pytest.approx(was.low)
    assert every["R_a"].high == pytest.approx(was.value * np.exp(0.5 + 1.96 * 0.01), rel=1e-3)
    assert every["K_m"].status == "compromise"  # tied to K_b
    assert every["K_m"].remark == "K_m = K_b"
    assert {i.status for i in lumped(replace(fitted, compromise=subsets(fitted.x, {}))).values()} == {"compromise"}


def test_a_combination_ranges_over_the_subsets_as_well(fitted: FitResult) -> None:
    k = fitted.free_parameters.layout.free.index("J_L")
    was, now = (lumped(r)["J_eq"] for r in (fitted, replace(fitted, compromise=subsets(fitted.x, {k: 0.7}))))
    assert was.status == "estimated"
    assert now.status == "compromise"
    assert now.stderr is None
    assert now.low is not None
    assert now.high is not None
    assert was.low is not None
    assert was.high is not None
    assert now.low <= was.low < was.high < now.high


def test_what_is_lost_stays_lost(fitted: FitResult) -> None:
    lost = replace(
        fitted, identifiability=replace(fitted.identifiability, lost=("L_a",)), compromise=subsets(fitted.x, {})
    )
    assert intervals(lost)["L_a"].status == "not identifiable"


def test_why_parameters_are_a_compromise() -> None:
    settings = FitSettings()
    assert compromise_reason(False, 1.0, (), settings) is None
    assert "far from the data" in (compromise_reason(True, 1.0, (), settings) or "")
    assert "chi2/dof 30" in (compromise_reason(False, 30.0, ("viscous",), settings) or "")
    assert compromise_reason(False, 1.1, ("viscous",), settings) == "viscous contradicts the other tests"
