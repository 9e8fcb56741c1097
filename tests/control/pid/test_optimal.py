"""The search of the optimum on costs that are known, without a plant; the swing that a relay is judged by."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.control.pid import Gains, experiments
from etcfit.control.pid.experiments import grids, swing_of
from etcfit.control.pid.optimal import FrontPoint, Scores, best_of_several, carried, cross_entropy
from etcfit.control.settings import ManualSettings, OptimumSettings

BEST = np.log((20.0, 300.0, 0.3))


def bowl(logs: np.ndarray) -> Scores:
    """Tracking error 1 % at BEST, rising with the distance; every requirement met."""
    return Scores(1.0 + np.sum((logs - BEST) ** 2, axis=1), np.zeros((1, len(logs))))


def begun(rng: np.random.Generator) -> np.ndarray:
    return BEST - 2.0 + rng.standard_normal((48, 3))


def test_the_search_finds_the_bottom_of_a_bowl() -> None:
    rng = np.random.default_rng(0)
    found, cost = cross_entropy(bowl, begun(rng), 36, rng)
    assert np.max(np.abs(found - BEST)) < 0.02
    assert cost == pytest.approx(1.0, abs=1e-3)


def test_the_best_so_far_is_never_lost() -> None:
    """The bottom is among the first population; every later one is spoilt."""
    rng = np.random.default_rng(1)
    begin = begun(rng)
    begin[17] = BEST
    first = [True]

    def spoilt(logs: np.ndarray) -> Scores:
        honest = first.pop() if first else False
        return bowl(logs) if honest else Scores(np.full(len(logs), 1e3), np.zeros((1, len(logs))))

    found, cost = cross_entropy(spoilt, begin, 5, rng)
    assert np.array_equal(found, BEST)
    assert cost == 1.0


def test_the_search_keeps_within_its_bounds() -> None:
    settings = OptimumSettings(highest=(6.0, 3e5, 40.0))
    rng = np.random.default_rng(2)
    asked = []

    def noted(logs: np.ndarray) -> Scores:
        asked.append(logs)
        return bowl(logs)

    begin = np.minimum(begun(rng) + 2.0, np.log((5.0, 1e9, 1e9)))
    found, _ = cross_entropy(noted, begin, 30, rng, settings)
    assert np.log(5.0) < found[0] <= np.log(6.0)
    tried = np.concatenate(asked[1:])[:, 0]
    assert tried.max() == np.log(6.0)  # where a draw beyond it was clipped to: the bottom of the bowl lies beyond


@pytest.mark.parametrize(("starts", "deepest"), [(1, False), (2, True)])
def test_a_deeper_valley_is_found_from_a_begin_that_fares_worse_at_first(starts: int, deepest: bool) -> None:
    """Near BEST a broad bowl; a narrow one, half as deep again, has the worse begin."""
    narrow = BEST + np.array((0.0, 4.0, 0.0))

    def two(logs: np.ndarray) -> Scores:
        broad = 1.0 + np.sum((logs - BEST) ** 2, axis=1)
        deep = 0.5 + 20.0 * np.sum((logs - narrow) ** 2, axis=1)
        return Scores(np.minimum(broad, deep), np.zeros((1, len(logs))))

    begins = np.array([BEST + 0.5, BEST + 0.55, narrow + np.array((0.0, 0.0, 0.3))])
    assert np.all(np.diff(two(begins).cost) > 0.0)
    found = best_of_several(two, begins, np.random.default_rng(3), OptimumSettings(starts=starts))
    assert found.shape == (OptimumSettings.elite, 3)
    assert bool(np.max(np.abs(found[0] - narrow)) < 0.05) is deepest


@pytest.mark.parametrize(("deeper", "populations"), [(1.05, 12), (2.0, 6)])
def test_a_search_that_is_far_behind_at_half_goes_no_further(deeper: float, populations: int) -> None:
    """Of two valleys 3 apart the other is `deeper` times as costly at its bottom."""
    settings, seen = OptimumSettings(starts=2, last_rounds=12), list[int]()

    def two(logs: np.ndarray) -> Scores:
        right = logs[:, 0] > 1.5
        seen.append(int(np.sum(right)))
        away = np.sum((logs - np.where(right, 3.0, 0.0)[:, None] * [1.0, 0.0, 0.0]) ** 2, axis=1)
        return Scores(np.where(right, deeper, 1.0) * (1.0 + away), np.zeros((1, len(logs))))

    begins = np.array([[0.1, 0.0, 0.0], [3.1, 0.0, 0.0]])
    found = best_of_several(two, begins, np.random.default_rng(3), settings)
    assert_allclose(found[0], 0.0, atol=0.05)
    assert sum(n > 0.9 * settings.population for n in seen) == 1 + populations  # the first one, then those drawn


def test_a_missed_requirement_costs_more_than_any_tracking_error() -> None:
    """Three gains over twenty draws: one meets all, one misses in one draw, one in two."""
    excess = np.zeros((20, 3))
    excess[:1, 1], excess[:2, 2] = 0.1, 0.1
    scores = Scores(np.array([9.0, 5.0, 1.0]), excess)
    # 95 % of twenty draws: the quantile lies between the largest two, so that one is too many
    missed = np.log(1.1) / 20.0 * np.arange(3)
    assert scores.missed == pytest.approx(missed)
    assert scores.cost == pytest.approx([9.0, 5.0 * (2.0 + 50.0 * missed[1]), 1.0 * (2.0 + 50.0 * missed[2])])
    assert Scores(scores.rmse, excess, OptimumSettings(certain=0.9)).missed[1] == 0.0
    lost = Scores(np.array([np.nan, 1.0]), np.array([[0.0, np.nan]]))
    assert (lost.cost >= 1e3).all()


def test_nothing_on_the_front_follows_worse_than_what_is_calmer() -> None:
    """Four searches, limits falling: the third found better gains than the second, the last misses something."""
    gains = [Gains(float(k), 1.0, 1.0) for k in range(4)]
    found = carried(
        (
            FrontPoint(np.inf, gains[0], 6.0, 0.6, meets=True),
            FrontPoint(5.0, gains[1], 4.5, 0.9, meets=True),
            FrontPoint(4.0, gains[2], 3.5, 0.7, meets=True),
            FrontPoint(3.0, gains[3], 2.5, 0.5, meets=False),
        )
    )
    assert [p.limit for p in found] == [np.inf, 5.0, 4.0, 3.0]
    assert [p.gains for p in found] == [gains[0], gains[2], gains[2], gains[3]]
    assert [(p.activity, p.rmse) for p in found][1] == (3.5, 0.7)


def test_the_manual_procedure_tries_gains_from_the_least_to_the_largest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "COUNT", 5)
    p, i, d = grids(ManualSettings(lowest=(0.2, 0.1, 1e-3), highest=(120.0, 5000.0, 3.0)))
    assert (p[0], p[-1], i[0], i[1], i[-1], d[0], d[1], d[-1]) == pytest.approx(
        (0.2, 120.0, 0.0, 0.1, 5000.0, 0.0, 1e-3, 3.0)
    )
    assert p[1] / p[0] == pytest.approx(p[2] / p[1])


def test_a_swing_has_the_amplitude_and_the_period_of_its_wave() -> None:
    time = 1e-3 * np.arange(1000)
    swung = swing_of(0.4 + 0.02 * np.sin(2.0 * np.pi * 8.0 * time + 0.3), 1e-3, turns=4)
    assert swung == pytest.approx((0.02, 0.125), rel=0.01)
    assert swing_of(0.4 + 0.02 * np.sin(2.0 * np.pi * 3.0 * time + 0.3), 1e-3, turns=4) is None
    assert swing_of(np.full(1000, 0.4), 1e-3, turns=4) is None
