"""What a long trace loses when it is drawn in few points: nothing of its extremes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from etcfit.reporting.interactive.traces import Bins


def test_a_short_trace_is_carried_whole() -> None:
    bins, value = Bins.of(50, 200), np.arange(50.0)
    assert bins.whole
    assert np.array_equal(bins.extremes(value), value)
    assert np.array_equal(bins.instants(value), value)


@pytest.mark.parametrize(("size", "most"), [(10_001, 200), (1003, 400), (201, 200)])
def test_least_and_most_of_every_run_are_there_in_their_order(size: int, most: int) -> None:
    rng = np.random.default_rng(size)
    time, value = np.sort(rng.uniform(0.0, 9.0, size)), rng.standard_normal(size)
    bins = Bins.of(size, most)
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
    drawn = Bins.of(value.size, 400).extremes(value)
    assert np.nanmax(drawn) == 7.0
    assert np.isnan(drawn[:2]).all()
    assert np.isfinite(drawn[4:]).all()
