"""Two parts of the data side by side: their own estimates, and what only one of them tells."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

import linear_parts as parts
from etcfit.estimation.statement import Split, Statement, inflations_of, statement

REACH = np.ones(parts.P)


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
    assert both.told_by_own.all()
    assert both.told_by_others.sum() == 2
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
    assert both.told_by_own.sum() == both.told_by_others.sum() == 2
    assert both.lost_without.tolist() == [True, False, True]
