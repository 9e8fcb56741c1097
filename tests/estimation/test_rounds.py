"""Searches without a gradient, on a function that stops every descent."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.estimation import rounds
from etcfit.estimation.rounds import evolve_population, search_about
from etcfit.estimation.settings import GlobalSearchSettings

MINIMUM = np.array([0.7, -0.3])


def rough(points: np.ndarray) -> np.ndarray:
    """Rastrigin's function, 1 at its minimum: a bowl with a local minimum in every cell of side 1."""
    from_there = points - MINIMUM
    return 1.0 + np.sum(from_there**2 + 2.0 * (1.0 - np.cos(2.0 * np.pi * from_there)), axis=1)


def test_a_population_finds_the_minimum_from_many_cells_away() -> None:
    start = MINIMUM + np.array([3.0, -4.0])  # the bottom of another cell: no descent leaves it
    assert rough(start[None])[0] > 25.0
    found = evolve_population(rough, start, np.array([3.0, 3.0]))
    assert np.max(np.abs(found - MINIMUM)) < 0.05


def test_a_population_is_never_worse_than_where_it_began() -> None:
    """At the minimum everything else is higher, and no generation is granted to find otherwise."""
    for epochs in (1, 40):
        found = evolve_population(rough, MINIMUM, np.array([2.0, 2.0]), GlobalSearchSettings(epochs=epochs))
        assert rough(found[None])[0] <= 1.0


def test_a_population_that_gains_nothing_is_given_up() -> None:
    asked = []

    def flat(points: np.ndarray) -> np.ndarray:
        asked.append(len(points))
        return np.ones(len(points))

    evolve_population(flat, np.zeros(2), np.ones(2), GlobalSearchSettings(patience=5))
    assert asked == [64] * 6  # the first population, and five generations


def test_where_the_model_has_no_value_nobody_goes() -> None:
    def cost(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] < 0.0, np.inf, rough(points))

    found = evolve_population(cost, MINIMUM + np.array([1.0, 1.0]), np.array([1.0, 1.0]))
    assert np.max(np.abs(found - MINIMUM)) < 0.05


def ripples(points: np.ndarray) -> np.ndarray:
    """A parabola with ripples of a hundredth of a standard deviation, on which a gradient says nothing."""
    away = points - MINIMUM
    return 100.0 + np.sum(away**2 + 0.01 * np.sin(600.0 * away), axis=1)


def test_draws_about_a_point_walk_down_to_the_minimum_and_say_that_no_more_is_to_be_had() -> None:
    end, gain = search_about(ripples, MINIMUM + np.array([1.5, -1.0]), np.eye(2), unit=1.0)
    assert np.max(np.abs(end - MINIMUM)) < 0.3
    assert gain < rounds.WORTH


def test_a_search_cut_short_says_what_its_last_move_gained() -> None:
    start = MINIMUM + np.array([8.0, 0.0])
    end, gain = search_about(ripples, start, np.eye(2), unit=2.0, settings=GlobalSearchSettings(draws=1))
    assert gain == pytest.approx((ripples(start[None])[0] - ripples(end[None])[0]) / 2.0)
    assert gain > 1.0


def test_a_move_that_is_not_worth_it_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rounds, "WORTH", 1e3)
    start = MINIMUM + np.array([1.5, -1.0])
    end, gain = search_about(ripples, start, np.eye(2), 1.0)
    assert np.array_equal(end, start)
    assert gain > 0.0
