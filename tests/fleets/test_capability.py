"""Capability: the formulas, intervals that hold, and sides without a limit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from etcfit.fleets.statistics.capability import Line, capability


def test_many_units_give_the_indices_of_the_book() -> None:
    found = capability(Line(10.0, 1e-3, 1e6, 1.0, (0.999, 1.001)), 7.0, 14.0)
    assert found.cp == pytest.approx(7.0 / 6.0)
    assert found.cpk == pytest.approx(1.0)
    assert found.outside == pytest.approx(stats.norm.cdf(-3.0) + stats.norm.sf(4.0))
    assert found.cpk_ci95 == pytest.approx((1.0, 1.0), abs=3e-3)


def test_one_limit_has_no_cp() -> None:
    found = capability(Line(10.0, 0.1, 50.0, 1.0, (0.8, 1.25)), -math.inf, 13.0)
    assert found.cp is None
    assert found.cp_ci95 is None
    assert found.cpk == pytest.approx(1.0)
    assert found.outside == pytest.approx(stats.norm.sf(3.0))
    assert found.cpk_ci95[0] < 1.0 < found.cpk_ci95[1]
    assert found.outside_ci95[0] < found.outside < found.outside_ci95[1]


def test_units_that_are_not_seen_to_differ_have_no_upper_bound() -> None:
    found = capability(Line(10.0, 0.1, 11.0, 0.0, (0.0, 0.5)), 8.0, 12.0)
    assert found.cp == math.inf
    assert found.cp_ci95 == pytest.approx((4.0 / 3.0, math.inf))
    assert 1.0 < found.cpk_ci95[0] < 4.0 / 3.0
    assert found.outside == 0.0


def test_a_figure_without_error_has_the_sample_sd_and_its_own_uncertainty_is_taken_off() -> None:
    value = stats.norm.ppf((np.arange(25) + 0.5) / 25, 0.1, 0.01)  # no draw: one in some seeds is far enough to be odd
    line = Line.from_values(value, np.zeros(25))
    assert line.sd == pytest.approx(value.std(ddof=1), rel=1e-3)
    assert line.mean == pytest.approx(value.mean())
    less = Line.from_values(np.append(value, np.nan), np.full(26, 0.008))
    assert less.sd == pytest.approx(math.sqrt(value.var(ddof=1) - 0.008**2), rel=1e-2)


def test_a_shared_symbol_has_no_capability() -> None:
    with pytest.raises(ValueError, match="no shared symbol"):
        capability(Line(1.0, 0.1, 10.0, 0.0, (math.nan, math.nan)), 0.0, 2.0)


@pytest.mark.slow
def test_the_ci95_of_cpk_holds_with_a_dozen_units_that_are_measured_badly() -> None:
    fleets, inside = 300, 0
    for seed in range(fleets):
        rng = np.random.default_rng(seed)
        value = rng.normal(0.0, 1.0, 12) + rng.normal(0.0, 0.7, 12)
        low, high = capability(Line.from_values(value, np.full(12, 0.7)), -4.0, 3.0).cpk_ci95
        inside += low <= 1.0 <= high
    assert stats.binom.ppf(0.0005, fleets, 0.92) <= inside <= stats.binom.ppf(0.9995, fleets, 0.98)
