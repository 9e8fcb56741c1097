"""One descent: known answers, points that cannot be computed, ends that are not believed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.estimation import levenberg_marquardt
from etcfit.estimation.levenberg_marquardt import descend, least_squares, linearise_at, minimise
from etcfit.problem import weights
from etcfit.problem.normal_equations import NormalEquations
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData
from held_plate import OHM, SIGMA, VOLTS, current, held_plate, problem_of

Held = tuple[EstimationProblem, WeightedData]


# ---- the solver by itself


def solved(function: Any, y0: list[float], tolerance: float, steps: int = 40) -> tuple[np.ndarray, int]:
    def equations(y: np.ndarray) -> NormalEquations:
        r, jacobian = np.asarray(function(y)), np.asarray(jax.jacfwd(function)(y))
        return NormalEquations(r @ r, jacobian.T @ r, jacobian.T @ jacobian)

    return least_squares(equations, lambda y: equations(y).chi2, np.array(y0), tolerance, steps)


def rosenbrock(y: Any) -> Any:
    """(1 - a)^2 + 100 (b - a^2)^2 is 0 at (1, 1) only."""
    return jnp.stack((1.0 - y[0], 10.0 * (y[1] - y[0] ** 2)))


def test_a_linear_problem_is_solved_in_a_few_steps() -> None:
    """argmin |A y - b|^2 = (A^T A)^-1 A^T b; columns of size 30 make the first damping 1e-3 of the curvature."""
    rng = np.random.default_rng(0)
    A, b = 30.0 * np.linalg.qr(rng.standard_normal((20, 3)))[0], rng.standard_normal(20)
    y, steps = solved(lambda y: jnp.asarray(A) @ y - jnp.asarray(b), [0.0, 0.0, 0.0], 1e-6)
    assert_allclose(y, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-8)
    assert steps <= 4


def test_a_direction_without_curvature_stays_where_it_is() -> None:
    """r = 30 (y_0 + y_1) - 3 knows the sum of both only; the step is the shortest."""
    y, _ = solved(lambda y: jnp.array([30.0 * (y[0] + y[1]) - 3.0]), [0.0, 0.0], 1e-9)
    assert_allclose(y, 0.05, atol=1e-7)


def test_slopes_are_asked_for_only_where_a_step_is_taken() -> None:
    """From (-1.2, 1) along Rosenbrock's valley some steps are too long; each raises the sum, and is not taken."""
    sums, slopes = [], []

    def chi2(y: np.ndarray) -> float:
        sums.append(float(np.sum(np.asarray(rosenbrock(y)) ** 2)))
        return sums[-1]

    def equations(y: np.ndarray) -> NormalEquations:
        r, jacobian = np.asarray(rosenbrock(y)), np.asarray(jax.jacfwd(rosenbrock)(y))
        slopes.append(float(r @ r))
        return NormalEquations(r @ r, jacobian.T @ r, jacobian.T @ jacobian)

    y, steps = least_squares(equations, chi2, np.array([-1.2, 1.0]), 1e-12, 60)
    assert_allclose(y, 1.0, atol=1e-6)
    assert len(sums) == steps - 1
    assert len(slopes) < steps - 2
    assert slopes == sorted(slopes, reverse=True)


@pytest.mark.parametrize("failed", [np.inf, np.nan, None], ids=["infinite", "nan", "finite"])
def test_a_point_without_finite_slopes_is_not_taken_whatever_its_sum(failed: float | None) -> None:
    def chi2(y: np.ndarray) -> float:
        return (30.0 * y[0] - 30.0) ** 2 if y[0] < 0.9 or failed is None else failed

    def equations(y: np.ndarray) -> NormalEquations:
        slope = 30.0 * (30.0 * y[0] - 30.0) if y[0] < 0.9 else np.nan
        return NormalEquations(chi2(y), np.array([slope]), np.array([[900.0]]))

    y, _ = least_squares(equations, chi2, np.array([0.0]), 1e-9, 20)
    assert 0.0 < y[0] < 0.9


def test_a_curved_valley_is_followed_to_its_end_unless_the_steps_run_out() -> None:
    begin = [-1.2, 1.0]
    y, steps = solved(rosenbrock, begin, 1e-12)
    assert_allclose(y, 1.0, atol=1e-6)
    assert steps > 4
    short, taken = solved(rosenbrock, begin, 1e-12, 3)
    assert taken == 3
    assert np.sum(np.square(rosenbrock(short))) < np.sum(np.square(rosenbrock(np.array(begin))))
    assert np.max(np.abs(short - 1.0)) > 0.1


def test_a_point_that_cannot_be_computed_is_stepped_back_from() -> None:
    """r = 30 (sqrt(y) - 1): from y = 9 the first full step leads to y < 0, where there is no root."""
    y, steps = solved(lambda y: 30.0 * (jnp.sqrt(y) - 1.0), [9.0], 1e-10)
    assert_allclose(y, 1.0, atol=1e-6)
    assert steps > 3


# ---- on a rig whose optimum is known


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Held:
    """Nothing is believed of R_a beforehand."""
    problem = problem_of(held_plate(tmp_path_factory.mktemp("rig"), "1.6"))
    return problem, problem.weighted(weights.free_running(problem))


@pytest.fixture(scope="module")
def believed(tmp_path_factory: pytest.TempPathFactory) -> Held:
    """R_a is believed to be 1.6 +- 0.2 ohm."""
    problem = problem_of(held_plate(tmp_path_factory.mktemp("rig")))
    return problem, problem.weighted(weights.free_running(problem))


def least_squares_ohm() -> float:
    """V over the mean current but for the first sample, at which the simulation begins at what was measured."""
    return VOLTS / float(np.mean(current()[1:]))


@pytest.mark.slow
def test_the_optimum_is_the_closed_form_from_a_start_at_twice_the_value(held: Held) -> None:
    problem, weighted = held
    start = problem.layout.coordinates({"R_a": 2.0 * OHM, "T_f": 0.2})
    end, steps = minimise(problem, start, weighted, 1e-8)
    assert problem.chi2(start, weighted) > 1e3 * problem.chi2(end, weighted)
    assert problem.layout.numbers(end)[0][0] == pytest.approx(least_squares_ohm(), rel=1e-6)
    assert 2 <= steps <= 15
    # what the data do not see stays where it was
    assert problem.layout.numbers(end)[0][1] == pytest.approx(0.2, rel=1e-6)


def test_a_point_where_the_model_has_no_value_stays_where_it_is(held: Held) -> None:
    problem, weighted = held
    nowhere = np.array([np.nan, 0.1])
    end, steps = minimise(problem, nowhere, weighted, 1e-6)
    assert_array_equal(end, nowhere)
    assert steps == 0


def test_an_end_that_is_not_lower_is_not_believed(believed: Held) -> None:
    """At the least squares of the data alone every end is higher in chi2, since the prior draws R_a away.

    T_f lies on its bound and is moved off it first; that descent is thrown away, and T_f with it.
    """
    problem, weighted = believed
    x = problem.layout.coordinates({"R_a": least_squares_ohm(), "T_f": 0.0})
    off = problem.layout.off_bounds(x)
    assert off[1] != x[1]
    astray, _ = minimise(problem, off, weighted, 1e-8)
    assert problem.chi2(astray, weighted) > problem.chi2(x, weighted)
    assert astray[1] == pytest.approx(off[1], abs=1e-6)
    end, _ = descend(problem, x, weighted, 1e-8)
    assert end[1] == pytest.approx(x[1], abs=1e-6)


def test_a_lower_end_off_a_bound_is_believed(held: Held) -> None:
    problem, weighted = held
    x = problem.layout.coordinates({"R_a": 2.0 * OHM, "T_f": 0.0})
    end, _ = descend(problem, x, weighted, 1e-8)
    assert problem.layout.numbers(end)[0][0] == pytest.approx(least_squares_ohm(), rel=1e-6)
    assert end[1] == pytest.approx(problem.layout.off_bounds(x)[1], abs=1e-6)


def test_the_covariance_is_that_of_a_mean_of_currents(held: Held) -> None:
    """sd(R) / R = sd(i) / i = sigma / (i sqrt(n)); no gain is left at the optimum."""
    problem, weighted = held
    x = problem.layout.coordinates({"R_a": least_squares_ohm(), "T_f": 0.2})
    here = linearise_at(problem, x, weighted)
    relative = SIGMA / (VOLTS / OHM) / np.sqrt(39.0)
    slope = problem.layout.numbers(x)[1][0] / least_squares_ohm()
    assert slope * np.sqrt(here.covariance[0, 0] / here.unit) == pytest.approx(relative, rel=1e-3)
    assert here.gain < 1e-9
    off = linearise_at(problem, x + np.array([3.0 * np.sqrt(here.covariance[0, 0]), 0.0]), weighted)
    assert off.gain == pytest.approx(9.0 * here.unit / off.unit, rel=0.05)


def test_where_derivatives_overflow_nothing_is_told_and_the_gain_is_infinite(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eigenvalues of such a matrix do not converge, and a diagnosis ended there."""
    problem, weighted = held
    x = problem.layout.coordinates({"R_a": OHM, "T_f": 0.2})
    told, plain = linearise_at(problem, x, weighted), levenberg_marquardt.normal_equations

    def overflown(*of: Any) -> Callable[[np.ndarray], NormalEquations]:
        found = plain(*of)(problem.layout.padded(x))
        return lambda _: NormalEquations(found.chi2, found.gradient, np.full(np.shape(found.information), np.inf))

    monkeypatch.setattr(levenberg_marquardt, "normal_equations", overflown)
    lost = linearise_at(problem, x, weighted)
    assert lost.gain == np.inf
    assert np.all(lost.step == 0.0)
    assert lost.covariance[0, 0] > 1e3 * told.covariance[0, 0]


def test_a_direction_that_nothing_tells_takes_no_step(held: Held, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a matrix has no inverse, and a diagnosis ended there."""
    problem, weighted = held
    x = problem.layout.coordinates({"R_a": 1.1 * OHM, "T_f": 0.2})
    told = linearise_at(problem, x, weighted)
    monkeypatch.setattr(levenberg_marquardt, "prior_information", lambda *_: np.zeros((2, 2)))
    here = linearise_at(problem, x, weighted)  # the plate is held: its friction is not seen
    assert here.step[1] == 0.0
    assert here.step[0] == pytest.approx(told.step[0], rel=1e-6)
    assert here.gain == pytest.approx(told.gain, rel=1e-6)
