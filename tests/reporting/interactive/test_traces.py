"""A long trace in few points keeps its extremes; an input in few corners keeps every jump."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from etcfit.reporting.interactive.plant import thinned
from etcfit.reporting.interactive.traces import Bins


def test_a_short_trace_is_carried_whole() -> None:
    bins, value = Bins.of_samples(50, 200), np.arange(50.0)
    assert bins.whole
    assert np.array_equal(bins.extremes(value), value)
    assert np.array_equal(bins.instants(value), value)


@pytest.mark.parametrize(("size", "most"), [(10_001, 200), (1003, 400), (201, 200)])
def test_least_and_most_of_every_run_are_there_in_their_order(size: int, most: int) -> None:
    rng = np.random.default_rng(size)
    time, value = np.sort(rng.uniform(0.0, 9.0, size)), rng.standard_normal(size)
    bins = Bins.of_samples(size, most)
    drawn, instants = bins.extremes(value), bins.instants(time)
    assert drawn.size == instants.size <= most
    assert np.all(np.diff(instants) > 0.0)
    edges = [*bins.starts.tolist(), size]
    for k, (a, b) in enumerate(pairwise(edges)):
        run = value[a:b]
        first, then = (run.min(), run.max()) if run.argmin() <= run.argmax() else (run.max(), run.min())
        assert drawn[2 * k : 2 * k + 2].tolist() == [first, then]
        assert time[a] <= instants[2 * k] <= instants[2 * k + 1] <= time[b - 1]


def test_one_spike_among_a_million_samples_is_seen_and_gaps_stay_gaps() -> None:
    value = np.zeros(1_000_000)
    value[123_456] = 7.0
    value[:5000] = np.nan
    drawn = Bins.of_samples(value.size, 400).extremes(value)
    assert np.nanmax(drawn) == 7.0
    assert np.isnan(drawn[:2]).all()
    assert np.isfinite(drawn[4:]).all()


@pytest.mark.parametrize("within", [0.0, 1e-3, 0.1])
def test_no_corner_is_missed_by_more_than_is_allowed(within: float) -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.5e-3, 2e-3, 4000))
    level = 3.0 * np.sin(2.0 * t) + 0.02 * rng.standard_normal(t.size)
    kept = thinned(t, level, within)
    assert (kept[0], kept[-1]) == (0, t.size - 1)
    assert np.max(np.abs(np.interp(t, t[kept], level[kept]) - level)) <= within + 1e-12
    assert kept.size <= t.size
    if within == 0.1:
        assert kept.size < 200


def test_a_staircase_keeps_both_ends_of_every_jump() -> None:
    t = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0, 3.0])
    level = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 4.0, 2.0, 2.0])
    assert thinned(t, level, 1e-6).tolist() == [0, 2, 3, 5, 6, 7]


def test_a_straight_line_is_its_ends() -> None:
    t = np.linspace(0.0, 1.0, 1000)
    assert thinned(t, 2.0 - 3.0 * t, 1e-9).tolist() == [0, 999]
