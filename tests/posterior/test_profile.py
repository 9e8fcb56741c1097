"""Profile likelihood: bounded where the data see a parameter, flat where they do not."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.estimation.levenberg_marquardt import linearise_at
from etcfit.posterior.profile import RISE, Profile, crossing, profile
from etcfit.posterior.target import Target, believed
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData


def test_the_end_of_an_interval_lies_where_the_rise_reaches_its_threshold() -> None:
    value = np.linspace(0.0, 3.0, 7)
    assert crossing(value, value**2) == pytest.approx(np.sqrt(RISE))
    assert crossing(value, 0.01 * value**2) is None


@pytest.mark.parametrize(
    ("low", "high", "kind"), [(1.0, 2.0, "bounded"), (None, 2.0, "one-sided"), (None, None, "flat")]
)
def test_profiles_are_classed_by_their_ends(low: float | None, high: float | None, kind: str) -> None:
    ends = Profile("R_a", np.zeros(3), np.zeros(3), low, high)
    assert ends.kind == kind
    assert (ends.sd is None) == (kind != "bounded")


@pytest.mark.slow  # compiles a descent
def test_a_held_plate_knows_its_resistance_and_nothing_of_its_friction(
    held: tuple[EstimationProblem, WeightedData],
) -> None:
    problem, weighted = held
    x = problem.layout.coordinates({"R_a": 1.513, "T_f": 0.2})
    told = believed(weighted, x, problem.layout.reach(x))
    for _ in range(6):  # Newton's steps to the mode: R_a alone is seen
        r, prior, jacobian = problem.linearise(x, told)
        flat = jacobian.reshape(-1, x.size)
        sd = np.asarray(told.prior_sd)
        x = x - np.linalg.solve(flat.T @ flat + np.diag(1 / sd**2), flat.T @ r.ravel() + prior / sd)
    target = Target(problem, told, x, linearise_at(problem, x, told).covariance, {})
    found = {symbol: profile(target, symbol) for symbol in ("R_a", "T_f")}
    assert (found["R_a"].kind, found["T_f"].kind) == ("bounded", "flat")
    slope = float(problem.layout.numbers(x)[1][0])
    assert found["R_a"].sd == pytest.approx(slope * np.sqrt(target.covariance[0, 0]), rel=0.02)
    assert np.max(np.abs(found["T_f"].rise)) < 1e-6
