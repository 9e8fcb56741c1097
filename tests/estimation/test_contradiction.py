"""A rig test that contradicts the others is named; where none does, or nothing fits, nobody is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import linear_parts as parts
from etcfit.estimation.agreement import in_words, outweighed_in_words
from etcfit.estimation.contradiction import (
    Comparison,
    Contradicting,
    Contradiction,
    Subset,
    by_consequence,
    contradiction_distance,
    digits_apart,
    disagreement,
    parted,
)
from etcfit.estimation.settings import ContradictionSettings
from etcfit.estimation.statement import Split, Statement, inflations_of, statement

REACH = np.ones(parts.P)


@dataclass
class Bench:
    """A linear problem that is fitted exactly, and counts how often."""

    seed: int
    off: dict[str, np.ndarray] = field(default_factory=dict)
    hum: float = 0.0  # of every residual: waves, as the second coordinate makes, but of another length
    fits: int = 0

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.every = parts.jacobians(rng, 200)
        if self.hum:
            for J in self.every.values():
                J[:, 1] = np.sin(np.arange(200) / 15.0)
        self.r = parts.residuals(rng, self.every, self.off)
        for r in self.r.values():
            r += self.hum * np.sin(np.arange(200) / 11.0 + rng.uniform(0.0, 2.0 * np.pi))

    def fit(self, _: np.ndarray, tests: tuple[str, ...]) -> Subset:
        self.fits += 1
        x = parts.optimum({key: J for key, J in self.every.items() if key[0] in tests}, self.r)
        return Subset(tests, x, parts.pieces(self.every, self.r, x), np.zeros(parts.P))

    def contradicting(self, level: float = 1e-3, understated: float = 1.0) -> tuple[Contradicting, ...]:
        settings = ContradictionSettings(level=level, understated=understated)
        comparison = Comparison(self.fit, lambda _: parts.nothing_believed(), REACH, 0.3, settings)
        return comparison.contradicting(self.fit(np.zeros(parts.P), tuple(parts.TESTS)))


def test_the_test_that_was_measured_elsewhere_is_named_and_what_the_others_say() -> None:
    for name in parts.TESTS:
        bench = Bench(1, {name: np.array([0.0, 0.4, 0.0])})
        (found,) = bench.contradicting()
        assert found.test == name
        assert found.p < 1e-6
        assert found.share > 0.9
        assert found.without.tests == tuple(test for test in parts.TESTS if test != name)
        assert abs(found.without.x[1]) < 0.1  # the others were measured at 0
        assert abs(found.together.x[1]) > 0.05


def test_where_all_agree_false_alarms_are_as_rare_as_stated() -> None:
    named = [bool(Bench(seed).contradicting(level=0.1)) for seed in range(300)]
    assert 0.03 < np.mean(named) < 0.15
    assert sum(bool(Bench(seed).contradicting()) for seed in range(300)) <= 3


def test_errors_larger_than_stated_are_no_contradiction_within_what_is_allowed_for() -> None:
    """Where errors are as stated alarms become rarer; a real contradiction is named all the same."""
    assert np.mean([bool(Bench(seed).contradicting(level=0.1, understated=1.5)) for seed in range(300)]) < 0.02
    (found,) = Bench(1, {"beta": np.array([0.0, 0.4, 0.0])}).contradicting(understated=1.5)
    assert found.test == "beta"


def test_where_all_agree_nothing_is_fitted_again() -> None:
    bench = Bench(2)
    assert bench.contradicting() == ()
    assert bench.fits == 1


def test_a_model_that_fits_nowhere_names_no_test() -> None:
    """The waves look like other coordinates to each test; their residuals show that they are not."""
    benches = [Bench(seed, hum=3.0) for seed in range(20)]
    assert sum(bool(bench.contradicting()) for bench in benches) <= 1
    assert sum(bench.fits > 1 for bench in benches) > 15  # they were looked into


def test_the_statistic_is_hausmans() -> None:
    """Two tests, one coordinate each: z = (x_own - x_others) / sqrt(var + var)."""
    rng = np.random.default_rng(0)
    every = {("a", "a/1.csv"): rng.standard_normal((500, 1)), ("b", "b/1.csv"): 2.0 * rng.standard_normal((500, 1))}
    r = parts.residuals(rng, every, {"a": np.array([0.2])})
    x = parts.optimum(every, r)
    here = Subset(("a", "b"), x, parts.pieces(every, r, x), np.zeros(1))
    two = parted(here, "a", parts.nothing_believed(1), np.ones(1), 1.0)
    own, others = (parts.optimum({key: every[key]}, r)[0] for key in every)
    variance = sum(1.0 / float(np.sum(J**2)) for J in every.values())
    t2 = (own - others) ** 2 / variance
    assert disagreement(two.split) == pytest.approx(stats.f.logsf(t2, 1, 500))
    assert disagreement(two.split, understated=1.5) == pytest.approx(stats.f.logsf(t2 / 1.5**2, 1, 500))
    assert two.misfit < sum(piece.misfit() for piece in here.pieces)


def test_sides_that_share_no_direction_cannot_disagree() -> None:
    rng = np.random.default_rng(0)
    every = {("a", "a/1.csv"): rng.standard_normal((100, 2)), ("b", "b/1.csv"): rng.standard_normal((100, 2))}
    every["a", "a/1.csv"][:, 0] = every["b", "b/1.csv"][:, 1] = 0.0
    r = parts.residuals(rng, every, {"a": np.array([0.0, 9.0])})
    x = parts.optimum(every, r)
    here = Subset(("a", "b"), x, parts.pieces(every, r, x), np.zeros(2))
    assert disagreement(parted(here, "a", parts.nothing_believed(2), np.ones(2), 1.0).split) == 0.0


def test_a_test_linearised_at_its_own_optimum_says_the_same_where_all_is_linear() -> None:
    bench = Bench(1, {"beta": np.array([0.0, 0.4, 0.0])})
    start, rest = np.zeros(parts.P), ("alpha", "gamma")
    there = bench.fit(start, rest)
    asked = there, "beta", parts.nothing_believed(), REACH, 0.3
    near, far = parted(*asked), parted(*asked, bench.fit(start, ("beta",)))
    assert disagreement(far.split) == pytest.approx(disagreement(near.split), rel=1e-6)
    assert disagreement(far.split) < -10.0
    assert far.misfit == pytest.approx(near.misfit)


@pytest.mark.parametrize(
    ("one", "other", "shown"),
    [
        (0.1680903, 0.1679567, ("0.16809", "0.16796")),
        (1.2e-3, 3.4e-3, ("0.0012", "0.0034")),
        (-5.0, 5.0, ("-5", "5")),
        (0.25, 0.25, ("0.25", "0.25")),
        (float("nan"), 1.0, ("nan", "1")),
    ],
)
def test_two_values_are_shown_with_the_digits_that_tell_them_apart(
    one: float, other: float, shown: tuple[str, str]
) -> None:
    digits = digits_apart(one, other)
    assert (f"{one:.{digits}g}", f"{other:.{digits}g}") == shown


def outweighed(weight: float, off: float) -> tuple[Bench, Contradicting]:
    """A test whose Jacobian is so much smaller than that of the others, measured at another place."""
    bench = Bench(1)
    for key in (key for key in bench.every if key[0] == "beta"):
        bench.every[key] *= weight
        bench.r[key] = np.random.default_rng(5).standard_normal(200) - bench.every[key] @ np.array([0.0, off, 0.0])
    tests = tuple(parts.TESTS)
    together = bench.fit(np.zeros(parts.P), tests)
    without = bench.fit(np.zeros(parts.P), tuple(test for test in tests if test != "beta"))
    return bench, Contradicting("beta", together, without, 1e-9, 0.9, 100.0)


def moved_by(each: Contradicting) -> float:
    return contradiction_distance(each, parts.nothing_believed(), REACH, 0.3)


def test_a_test_that_the_others_outweigh_moves_nothing_however_far_off_it_is() -> None:
    """Its columns a hundredth of the others', it is some 20 of its own standard errors off, and moves them by 0.14."""
    assert moved_by(outweighed(0.01, 100.0)[1]) < 0.5
    assert moved_by(outweighed(1.0, 0.4)[1]) > 4.0


def test_no_parameter_moves_by_more_than_the_distance() -> None:
    _, each = outweighed(0.5, 0.4)
    information = sum(piece.jacobian.T @ piece.jacobian for piece in each.together.pieces)
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    moved = np.abs(each.without.x - each.together.x) / sd
    change = each.without.x - each.together.x
    assert moved_by(each) == pytest.approx(np.sqrt(change @ information @ change), rel=1e-6)
    assert np.max(moved) <= moved_by(each)


@pytest.mark.parametrize("pull", [0.053, -0.999])
def test_a_pull_below_one_standard_error_is_no_evidence(pull: float) -> None:
    said = in_words(Contradiction("response", "K_s", pull, 0.15, 0.1501, 1e-9, 0.9, 7.3), "N*m/rad")
    assert "a combination of parameters moves by 7.3 standard errors" in said
    assert "K_s" not in said
    assert f"{pull:.2g}" not in said


@pytest.mark.parametrize("pull", [1.0, -34.0])
def test_a_pull_of_one_standard_error_or_more_is_shown(pull: float) -> None:
    said = in_words(Contradiction("response", "K_s", pull, 0.15, 0.16, 1e-9, 0.9, 40.0), "N*m/rad")
    assert "without it K_s is 0.16 N*m/rad instead of 0.15 " in said
    assert f"({pull:+.2g} standard errors of noise alone)" in said


@pytest.mark.parametrize(("moved", "real"), [(0.053, False), (0.999, False), (1.0, True), (8.0, True)])
def test_what_moves_nothing_is_no_contradiction(moved: float, real: bool) -> None:
    found = Contradiction("response", "K_s", moved, 0.15, 0.15, 1e-9, 0.9, moved)
    assert by_consequence([found], ContradictionSettings().moves) == (((found,), ()) if real else ((), (found,)))
    said = outweighed_in_words(found)
    assert "contradicts" not in said
    assert f"no parameter moves by more than {moved:.2g} standard errors" in said


# ---- Two parts of the data side by side: their own estimates, and what only one of them tells


def split(seed: int = 0, blind: bool = False) -> tuple[Split, np.ndarray, np.ndarray]:
    """alpha against the others; the coordinates that each would choose, shape (P,). Blind others see no third one."""
    rng = np.random.default_rng(seed)
    every = parts.jacobians(rng)
    if blind:
        for key, J in every.items():
            if key[0] != "alpha":
                J[:, 2] = 0.0
    r = parts.residuals(rng, every)
    x = parts.optimum(every, r)
    found = parts.pieces(every, r, x)
    sides = ([p for p in found if p.test == "alpha"], [p for p in found if p.test != "alpha"])
    own, others = (statement(side, [1.0] * len(side)) for side in sides)
    rest = parts.without(every, "alpha")
    alone = {key: J for key, J in every.items() if key[0] == "alpha"}
    return (
        Split(own, others + parts.nothing_believed(), REACH, 0.3),
        parts.optimum(alone, r) - x,
        parts.optimum(rest, r) - x,
    )


def test_each_side_steps_to_its_own_least_squares() -> None:
    both, own, others = split()
    assert_allclose(both.own_step, own, rtol=1e-7)
    assert_allclose(both.others_step, others, rtol=1e-7)
    assert_allclose(both.shift, others, rtol=1e-7)
    assert not both.lost_without.any()


def test_the_directions_are_orthonormal_in_the_information_of_both() -> None:
    both, _, _ = split()
    b = both.directions
    assert_allclose(b.T @ (both.own.information + both.others.information) @ b, np.eye(parts.P), atol=1e-9)
    assert_allclose(b.T @ both.own.information @ b, np.diag(both.share), atol=1e-9)


def test_what_only_one_side_tells_is_lost_without_it_and_does_not_move() -> None:
    both, _, others = split(blind=True)
    assert both.lost_without.tolist() == [False, False, True]
    assert both.determined_by_own.all()
    assert both.determined_by_others.sum() == 2
    assert_allclose(both.shift[:2], others[:2], rtol=1e-6)


def test_inflation_is_of_the_residual_after_the_step() -> None:
    rng = np.random.default_rng(1)
    J = np.ones((400, 1))
    piece = parts.pieces({("a", "a/1.csv"): J}, {("a", "a/1.csv"): rng.standard_normal(400) + 3.0}, np.zeros(1))
    assert inflations_of(piece)[0] > 5.0
    assert inflations_of(piece, np.array([-3.0])) == [1.0]


def test_two_coordinates_that_do_the_same_leave_the_others_known() -> None:
    """Two effects that imitate each other to the last digit: what remains of their difference is rounding."""
    power = 200.0 * np.array([[4.0, 0.0, 4.0], [0.0, 1.0, 0.0], [4.0, 0.0, 4.0]])
    side = Statement(power, np.zeros(3), power, 400.0)
    both = Split(side, side, np.ones(3), 0.3)
    assert both.determined_by_own.sum() == both.determined_by_others.sum() == 2
    assert both.lost_without.tolist() == [True, False, True]
