"""The log-probability: worked out by hand where that can be done, and of what the fit minimises everywhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import results
from etcfit.estimation.identifiability import WIDE
from etcfit.posterior.target import Target, believed, tempered, truths
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData

SIGMA, VOLTS = 0.01, 2.0  # as in conftest.py


def target(
    problem: EstimationProblem, weighted: WeightedData, factors: dict[tuple[str, str], float] | None = None
) -> Target:
    size = len(problem.layout.free)
    return Target(problem, weighted, np.zeros(size), np.eye(size), factors or {})


def by_hand(problem: EstimationProblem, ohm: float, friction: float, factor: float = 1.0) -> float:
    """-1/2 |r|^2 / f - 1/2 ((x - m) / s)^2 + log sech^2(x / 12) + log(dq/dx), q = T_f / scale."""
    trace = problem.batch.traces[0]
    # the first sample is where the simulation sets out from; after it L_a is too small to matter
    r = (trace.data[1:, 0] - VOLTS / ohm) / SIGMA
    first = (trace.data[0, 0] - trace.start.state[0]) / SIGMA
    scale = {s: problem.layout.parameter(s).domain.scale for s in ("R_a", "T_f")}

    def coordinate(value: float) -> float:
        return 12.0 * np.arctanh(np.log(value / scale["R_a"]) / 12.0)

    x = coordinate(ohm)
    slope = scale["R_a"] * np.exp(12.0 * np.tanh(coordinate(1.6) / 12.0)) / np.cosh(coordinate(1.6) / 12.0) ** 2
    prior = (x - coordinate(1.6)) / (0.2 / slope)
    q = friction / scale["T_f"]
    y = q - 0.02**2 / (4.0 * q)
    jacobian = -2.0 * np.log(np.cosh(x / 12.0)) + np.log(0.5 * (1.0 + y / np.sqrt(y**2 + 0.02**2)))
    return -0.5 * (float(np.sum(r**2)) + first**2) / factor - 0.5 * prior**2 + jacobian


def test_the_log_probability_is_the_one_worked_out_by_hand(held: tuple[EstimationProblem, WeightedData]) -> None:
    problem, weighted = held
    assert problem.layout.free == ("R_a", "T_f")
    pairs = [(1.5, 0.2), (1.513, 0.01), (1.53, 0.0021)]
    points = np.stack([problem.layout.coordinates({"R_a": ohm, "T_f": friction}) for ohm, friction in pairs])
    assert_allclose(
        target(problem, weighted).log_probability(points), [by_hand(problem, *pair) for pair in pairs], rtol=1e-7
    )


def test_tempering_divides_each_channels_squared_residuals(held: tuple[EstimationProblem, WeightedData]) -> None:
    problem, weighted = held
    factors = {("resistance/1.csv", "current"): 7.0}
    point = problem.layout.coordinates({"R_a": 1.52, "T_f": 0.2})[None]
    cooled = target(problem, tempered(problem, weighted, factors), factors)
    assert_allclose(cooled.log_probability(point), by_hand(problem, 1.52, 0.2, factor=7.0), rtol=1e-7)


def test_what_cannot_be_computed_has_no_probability(held: tuple[EstimationProblem, WeightedData]) -> None:
    problem, weighted = held
    assert target(problem, weighted).log_probability(np.array([[np.nan, 0.0]]))[0] == -np.inf


def test_a_belief_weighs_only_on_what_has_no_prior(held: tuple[EstimationProblem, WeightedData]) -> None:
    _, weighted = held
    x, reach = np.array([0.1, 0.3]), np.array([1.0, 2.0])
    told = believed(weighted, x, reach)
    assert_allclose(told.prior_sd[0], weighted.prior_sd[0])
    assert_allclose((told.prior_mean[1], told.prior_sd[1]), (0.3, 2.0 * WIDE))


def test_what_lies_on_its_bound_is_sought_off_it(held: tuple[EstimationProblem, WeightedData]) -> None:
    problem, weighted = held
    mode = np.array([0.03, -31.0])  # T_f is 0: no change of its coordinate changes it
    kept = target(problem, weighted)
    at_bound = Target(problem, weighted, mode, kept.covariance, {})
    point, covariance = at_bound.start()
    assert point[0] == mode[0]
    assert problem.layout.numbers(point)[1][1] > 1e3 * problem.layout.numbers(mode)[1][1]
    assert not np.array_equal(covariance, kept.covariance)
    inside = Target(problem, weighted, point, kept.covariance, {})
    assert inside.start() == (inside.mode, inside.covariance)


@pytest.mark.slow
def test_the_chunks_of_a_large_ensemble_are_put_together_again(held: tuple[EstimationProblem, WeightedData]) -> None:
    problem, weighted = held
    whole = target(problem, weighted)
    points = np.array([0.03, 0.2]) + 0.01 * np.random.default_rng(0).standard_normal((300, 2))
    alone = np.concatenate([whole.log_probability(points[k : k + 1]) for k in (0, 150, 299)])
    assert_allclose(whole.log_probability(points)[[0, 150, 299]], alone, rtol=1e-12)
    assert len(set(alone)) == 3


NOTE = {"parameters": {"R_a": 1.6, "J_m": 1e-6}, "series_ohm": 1.2}


@pytest.mark.parametrize("synthetic", [True, False])
def test_a_note_counts_for_synthetic_data_only(synthetic: bool, tmp_path: Path) -> None:
    rig = results.rig(tmp_path / "rig", synthetic)
    assert truths(rig) == {}
    (tmp_path / "rig" / "truth.json").write_text(json.dumps(NOTE), encoding="utf-8")
    assert truths(rig) == ({"R_a": 1.6, "J_m": 1e-6, "series_ohm.inductance": 1.2} if synthetic else {})
