"""Corners of an input: few, near enough, and every jump where it was."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.reporting.interactive.excitation import thinned


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
