"""Means on a circle, and chances that are those of points drawn at random."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.rig.circle import apart, arc_chance, on_circle, rayleigh_chance

DRAWS = 20_000


def test_the_mean_of_points_on_either_side_of_zero_is_zero() -> None:
    assert on_circle(np.array([0.95, 0.05])).mean == pytest.approx(0.0)
    assert on_circle(np.array([0.2, 0.4])).mean == pytest.approx(0.3)


def test_points_weigh_as_much_as_they_are_sure() -> None:
    assert on_circle(np.array([0.1, 0.3]), np.array([1e6, 1.0])).mean == pytest.approx(0.1, abs=1e-5)


def test_the_spread_is_the_standard_deviation_of_points_that_lie_together() -> None:
    points = np.random.default_rng(0).normal(0.9, 0.03, 20_000)
    found = on_circle(points % 1.0)
    assert found.mean == pytest.approx(-0.1, abs=1e-3)
    assert found.spread == pytest.approx(0.03, rel=0.02)
    assert on_circle(np.full(3, 0.2)).spread == pytest.approx(0.0, abs=1e-5)


def test_points_are_apart_the_shorter_way_round() -> None:
    assert apart(np.array([0.9, 0.1, 0.55]), 0.0) == pytest.approx([-0.1, 0.1, -0.45])
    assert apart(np.array([0.05]), 0.95) == pytest.approx([0.1])


@pytest.mark.parametrize("chance", [rayleigh_chance, arc_chance])
@pytest.mark.parametrize("level", [0.2, 0.05])
def test_points_at_random_lie_as_close_together_as_often_as_the_chance_says(chance, level: float) -> None:
    drawn = np.random.default_rng(1).uniform(size=(DRAWS, 6))
    found = np.mean([chance(points) <= level for points in drawn])
    # 4 standard errors of the count; Rayleigh's is asymptotic, a tenth off at six points
    assert found == pytest.approx(level, abs=0.1 * level + 4.0 * np.sqrt(level / DRAWS))


def test_an_arc_of_more_than_half_a_turn_says_nothing() -> None:
    assert arc_chance(np.array([0.0, 0.3, 0.6])) == 1.0
    assert arc_chance(np.array([0.95, 0.05])) == pytest.approx(2 * 0.1)
