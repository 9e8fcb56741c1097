"""The phase of edges within a sample, from currents made by hand.

Means on a circle, and chances that are those of points drawn at random.
"""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.rig.base import Channel, Measurement
from etcfit.rig.checks.edges import apart, arc_chance, edge_phase, edge_phases, on_circle, rayleigh_chance

R, TAU, STEP, SIGMA = 1.5, 1e-3, 1e-3, 0.005  # ohm, s, s, A


def edges(phases: np.ndarray, seed: int = 0) -> Measurement:
    """A held plate at 1 kHz: steps between 1 and 3 V, each so many sample intervals before the sample that shows it."""
    rng, period = np.random.default_rng(seed), 40
    time = STEP * np.arange(period * (phases.size + 1))
    instants = STEP * (period * np.arange(1, phases.size + 1) - phases)
    volts, current = np.full(time.size, 1.0), np.full(time.size, 1.0 / R)
    for k, instant in enumerate(instants):
        jump, after = 2.0 * (-1.0) ** k, time >= instant - 1e-9
        volts = volts + jump * after
        current = current + after * jump / R * (1.0 - np.exp(-np.maximum(time - instant, 0.0) / TAU))
    channels = {"voltage": volts + 0.01 * rng.standard_normal(time.size),
                "current": current + SIGMA * rng.standard_normal(time.size)}  # fmt: skip
    made = {n: Channel(time, v, 0.01 if n == "voltage" else SIGMA, False, n, "", 1.0) for n, v in channels.items()}
    return Measurement("response/1.csv", "response", time, made)


@pytest.mark.parametrize("phase", [0.1, 0.5, 0.93])
def test_a_common_phase_is_found_with_its_error(phase: float) -> None:
    found = edge_phase([edges(np.full(12, phase))])
    assert found is not None
    assert found.phase == pytest.approx(phase, abs=max(4 * found.error, 0.02))
    assert found.error < 0.02
    assert found.chance < 1e-4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("phase", [0.0, 0.9999])
def test_an_edge_on_its_sample_and_one_a_whole_interval_earlier_are_not_the_same(phase: float, seed: int) -> None:
    found = edge_phase([edges(np.full(12, phase), seed)])
    assert found is not None
    assert found.phase == pytest.approx(phase, abs=0.02)


def test_each_edge_tells_its_own_phase() -> None:
    phases = np.linspace(0.05, 0.95, 16)
    assert edge_phases([edges(phases)]) == pytest.approx(phases, abs=0.05)


@pytest.mark.parametrize("seed", range(20))
def test_edges_at_any_instant_have_none(seed: int) -> None:
    assert edge_phase([edges(np.random.default_rng(seed).uniform(size=12), seed)]) is None


def test_few_edges_say_nothing() -> None:
    assert edge_phase([edges(np.full(3, 0.5))]) is None


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
