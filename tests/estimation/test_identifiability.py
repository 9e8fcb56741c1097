"""What the data cannot tell, found and named."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

import results
from etcfit.estimation.identifiability import EXCITED_BY, RULES, TOLD_BY, Cure, Direction, analyse, sentence, sentences
from etcfit.model.effects import PAPER
from etcfit.model.parameters import Parameter, Positive, Real
from etcfit.model.throttle import catalogue
from etcfit.problem.free_parameters import Layout, free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.problem.weights import free_running
from etcfit.rig import TEST_BY_NAME
from etcfit.rig.base import Start
from independent import CONSISTENT, NONE
from independent import simulate as independent
from independent.drives import Drive, steps
from measurements import CONFIG, N, driven, measurement, noisy

# ---- by hand: rows of a Jacobian in logarithms


def layout(*symbols: str) -> Layout:
    parameters = tuple(Parameter(s, "V", Positive(1.0), 1.0, s, "a test") for s in symbols)
    return Layout((), parameters, symbols, (), ())


def information(*rows: tuple[float, ...], sigma: float = 0.01) -> np.ndarray:
    J = np.array(rows, dtype=float) / sigma
    return J.T @ J


def test_nothing_is_lost_in_a_well_posed_problem() -> None:
    known = information((1, 0, 0.2), (0.3, 1, 0), (0, 0.5, 1))
    verdict = analyse(layout("a", "b", "c"), np.zeros(3), known)
    assert verdict.lost == ()
    assert verdict.directions == ()
    assert_allclose(verdict.covariance, np.linalg.inv(known), rtol=1e-3)
    assert_allclose(verdict.singular_values, np.linalg.svd(np.linalg.cholesky(known), compute_uv=False))


def test_a_product_is_known_and_its_factors_are_not() -> None:
    """log(a b) = log a + log b."""
    verdict = analyse(layout("a", "b", "c"), np.zeros(3), information((1, 1, 0), (0, 0, 1)))
    assert verdict.lost == ("a", "b")
    (direction,) = verdict.directions
    assert direction.null
    assert set(direction.symbols) == {"a", "b"}
    assert_allclose(np.abs(direction.shares), np.sqrt(0.5))
    assert direction.shares[0] * direction.shares[1] < 0.0  # one up, the other down
    assert_allclose(verdict.covariance[2, 2], 1e-4, rtol=1e-3)
    product = np.array([1.0, 1.0, 0.0])
    assert_allclose(product @ verdict.covariance @ product, 1e-4, rtol=1e-2)  # as well known as before


def test_two_products_are_two_directions_of_two_symbols_each() -> None:
    verdict = analyse(layout("a", "b", "c", "d"), np.zeros(4), information((1, 1, 0, 0), (0, 0, 1, -1)))
    assert {frozenset(d.symbols) for d in verdict.directions} == {frozenset("ab"), frozenset("cd")}
    assert verdict.lost == ("a", "b", "c", "d")


def test_a_symbol_that_enters_nowhere_is_lost_alone() -> None:
    verdict = analyse(layout("a", "b"), np.zeros(2), information((1, 0)))
    assert verdict.lost == ("b",)
    assert verdict.directions[0].symbols == ("b",)
    assert np.isfinite(verdict.covariance).all()


def test_a_weak_direction_is_named_but_not_lost() -> None:
    verdict = analyse(layout("a", "b"), np.zeros(2), information((1, 1), (0.05, -0.05)))
    assert verdict.lost == ()
    (direction,) = verdict.directions
    assert not direction.null
    assert 0.1 < direction.sd < 0.3


@pytest.mark.parametrize(("value", "lost"), [(0.1, ("a", "b")), (0.01, ("a",))])
def test_a_small_parameter_is_lost_with_the_scale_that_it_is_told_in(value: float, lost: tuple[str, ...]) -> None:
    """Of b only b / a is told, within 0.03 of b's usual size. That b is small, be a what it may: no error of b is large
    beside its usual size. Where b is not 0 its error is that of a; where it may be 0 it is known to be small."""
    parameters = (
        Parameter("a", "V", Positive(1.0), 1.0, "a", "a test"),
        Parameter("b", "V", Real(1.0), 1.0, "b", "a test"),
    )
    both = Layout((), parameters, ("a", "b"), (), ())
    verdict = analyse(both, np.array([0.0, value]), information((-value, 1.0), (0.01, 0.0), sigma=0.03))
    assert verdict.lost == lost


def test_a_prior_makes_identifiable() -> None:
    verdict = analyse(layout("a", "b"), np.zeros(2), information((1, 1)) + np.diag([0.0, 1.0 / 0.05**2]))
    assert verdict.lost == ()


# ---- the throttle


@pytest.fixture(scope="module")
def freed() -> tuple[Layout, np.ndarray, np.ndarray]:
    """Layout, coordinates of the truth and information of a driven plate and a motor alone, K_m set free."""
    truth = CONSISTENT
    knocks = steps(np.full(8, 0.1), np.array([3.5, 1.0, 4.5, 0.5, 3.0, 1.5, 5.0, 0.0]))
    motion = driven(knocks, 0.0)
    time = np.arange(0.0, 0.4, 1e-3)
    alone = independent.simulate(
        independent.motor_alone(truth, NONE), Drive(np.array([0.0, 0.02, 0.02, 0.5]), np.array([0, 0, 6, 6.0])), time,
        angle=0.0,
    )  # fmt: skip
    response = {"voltage": motion.voltage, "current": motion.current, "position": motion.angle}
    run_up = {"voltage": alone.voltage, "current": alone.current, "motor_speed": N * alone.speed}
    measured = measurement("response", motion.time, response), measurement("viscous", time, run_up)
    traces = [prepare(noisy(m, 0), CONFIG) for m in measured]
    known = free_parameters(replace(CONFIG, parameters={"K_m": Start(0.0189)}))
    problem = EstimationProblem.of_traces(CONFIG, known, tuple(t for t in traces if t))
    x = known.layout.coordinates({s: getattr(truth, s) for s in known.layout.free})
    jacobian = problem.linearise(x, problem.weighted(free_running(problem))).jacobian
    flat = jacobian.reshape(-1, x.size)
    return known.layout, x, flat.T @ flat


SCALE = ("K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")


def test_without_a_torque_sensor_a_free_k_m_loses_the_scale(freed: tuple[Layout, np.ndarray, np.ndarray]) -> None:
    """Everything mechanical times one factor: the plate moves as before. Found, and named by all that it mixes."""
    layout, x, known = freed
    verdict = analyse(layout, x, known)
    assert set(verdict.lost) & {"R_a", "L_a", "K_b"} == set()
    assert set(verdict.lost) >= {"K_m", "J_m", "T_PL"}
    worst = verdict.directions[0]
    assert worst.null
    assert set(worst.symbols) <= set(SCALE)
    assert set(worst.symbols) >= {"K_m", "J_m", "B_m", "K_s", "T_PL", "T_f"}
    slope = [float(jax.grad(layout.parameter(s).domain.value)(v)) for s, v in zip(layout.free, x, strict=True)]
    wanted = np.array([getattr(CONSISTENT, s) * (s in SCALE) for s in layout.free]) / slope / layout.reach(x)
    found = np.zeros(x.size)
    found[[layout.free.index(s) for s in worst.symbols]] = worst.shares
    assert abs(found @ wanted) / np.linalg.norm(wanted) / np.linalg.norm(found) > 0.98


def test_the_tie_gives_the_scale_back(freed: tuple[Layout, np.ndarray, np.ndarray]) -> None:
    """K_m = K_b: in logarithms the two columns add up."""
    layout, x, known = freed
    m, b = layout.free.index("K_m"), layout.free.index("K_b")
    tie = np.delete(np.eye(x.size), m, axis=1)
    tie[m, b - (b > m)] = 1.0
    tied = replace(layout, free=tuple(s for s in layout.free if s != "K_m"), ties=(("K_m", "K_b"),))
    verdict = analyse(tied, np.delete(x, m), tie.T @ known @ tie)
    assert verdict.lost == ()
    assert not any(direction.null for direction in verdict.directions)


# ---- Directions in words: the parameters by name, and the measurement that would tell them apart


def said(*symbols: str, sd: float = np.inf, made: tuple[str, ...] = ()) -> str:
    return sentence(Direction(symbols, (1.0,) * len(symbols), sd), made)


@pytest.mark.parametrize(
    ("symbols", "words"),
    [
        (("K_m", "J_L", "B_L", "K_s", "T_PL", "T_f"), "K_m, J_L, B_L, K_s, T_PL and T_f share one scale"),
        (("K_m", "J_L", "B_L", "K_s", "T_PL", "T_f"), "only K_m = K_b, a torque sensor, or one known torque"),
        (("K_s", "T_f", "T_PL", "J_m", "R_a", "K_b"), "log the current"),
        (("J_m", "J_L"), "J_m and J_L are seen only as N^2 J_m + J_L: a motor-alone test"),
        (("B_L", "B_m"), "B_L and B_m are seen only as N^2 B_m + B_L: a motor-alone test"),
        (("R_a", "series_ohm.inductance"), "a resistance test"),
        (("R_a", "series_ohm.inductance"), "tests.inductance.series_ohm"),
        (("L_a",), "L_a is hardly seen in these data: an inductance test"),
        (("L_a",), "sampling faster"),
        (("T_PL", "T_f"), "static_load/"),
        (("K_b", "B_L"), "back_emf/"),
        (("odd", "even"), "odd and even are seen only in one combination: fix odd in rig.toml"),
    ],
)
def test_a_direction_names_its_parameters_and_its_cure(symbols: tuple[str, ...], words: str) -> None:
    assert words in said(*symbols)


CURES: list[Cure] = [*(rule.cure for rule in RULES), *TOLD_BY.values()]


@pytest.mark.parametrize("cure", [cure for cure in CURES if cure.tests], ids=lambda cure: cure.words(()))
def test_a_test_that_was_made_is_not_advised_as_if_it_were_not(cure: Cure) -> None:
    absent = cure.words(())
    assert all(str(way) in absent for way in cure.tests)
    made = cure.words([way.test for way in cure.tests])
    assert not any(way.name in made for way in cure.tests)
    assert all(f"{way.test}/" in made for way in cure.tests)
    assert "there but tell" in made
    assert "etcfit check --advise" in made
    assert cure.besides in made


def test_of_two_tests_the_one_that_is_missing_is_advised() -> None:
    assert "a free fall of the plate (inertia/" in said("J_L")
    found = said("J_L", made=("inertia", "response"))
    assert found == (
        "J_L is hardly seen in these data: a motor-alone test (viscous/: gear apart, voltage steps to several speeds) "
        "tells J_L."
    )


def test_every_test_that_is_advised_is_one() -> None:
    assert {way.test for cure in CURES for way in cure.tests} <= set(TEST_BY_NAME)


def test_the_traces_that_were_fitted_are_known_to_be_there(tmp_path: Path) -> None:
    problem = results.result(results.rig(tmp_path)).problem
    (found,) = sentences([Direction(("L_a",), (1.0,), np.inf)], problem.batch.traces)
    assert found.startswith(
        "L_a is hardly seen in these data: inductance/ is there but tells too little: sampling faster"
    )


def test_a_weak_direction_says_how_weak() -> None:
    assert "(known to 23 % only)" in said("J_m", "J_L", sd=0.23)
    assert "%" not in said("J_m", "J_L")


def test_every_parameter_of_the_paper_has_a_test_that_tells_it() -> None:
    assert set(TOLD_BY) == set(catalogue(PAPER))


def test_every_rule_can_speak() -> None:
    """For some symbols it is the first that fits: none stands behind another that always speaks before it."""
    known = (*TOLD_BY, *EXCITED_BY)
    every = (frozenset(some) for count in range(1, 5) for some in combinations(known, count))
    speaking = {next((rule.says for rule in RULES if rule.fits(symbols)), None) for symbols in every}
    assert {rule.says for rule in RULES} <= speaking
