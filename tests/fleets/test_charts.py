"""Charts and drift: limits, run lengths, and changes that are found where they are and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from etcfit.fleets.statistics.charts import DECISION, chart, drifts, run_length, short_term_sd, weighed_median


def names(count: int) -> tuple[str, ...]:
    return tuple(f"u{k}" for k in range(count))


def test_the_short_term_sd_takes_the_units_own_error_off_and_sees_no_drift() -> None:
    rng = np.random.default_rng(1)
    stderr = rng.uniform(0.5, 1.5, 4000)
    value = rng.normal(0.0, 1.0, 4000) + stderr * rng.standard_normal(4000)
    assert short_term_sd(value, stderr) == pytest.approx(1.0, abs=0.08)
    assert short_term_sd(value + 0.01 * np.arange(4000), stderr) == pytest.approx(1.0, abs=0.08)
    assert short_term_sd(value - value + 3.0, stderr) == 0.0


def test_limits_are_as_wide_as_the_unit_is_uncertain() -> None:
    rng = np.random.default_rng(2)
    stderr = np.where(np.arange(200) < 100, 0.0, 2.0)
    value = rng.normal(5.0, 1.0, 200) + stderr * rng.standard_normal(200)
    value[50] += 8.0
    found = chart(names(200), value, stderr)
    half = 0.5 * (found.upper - found.lower)
    np.testing.assert_allclose(half, 3.0 * np.hypot(found.sd, stderr))
    outside = (value < found.lower) | (value > found.upper)
    assert outside[50]
    assert outside.sum() <= 4
    assert found.centre == pytest.approx(5.0, abs=0.4)


def test_the_cusum_is_the_recursion_and_alarms_after_a_shift() -> None:
    rng = np.random.default_rng(3)
    value = rng.standard_normal(300) + np.where(np.arange(300) >= 200, 1.5, 0.0)
    found = chart(names(300), value, np.zeros(300))
    z, high, low = (value - found.centre) / found.sd, 0.0, 0.0
    for u in range(300):
        high, low = max(0.0, high + z[u] - 0.5), max(0.0, low - z[u] - 0.5)
        assert found.cusum_high[u] == pytest.approx(high, abs=1e-9)
        assert found.cusum_low[u] == pytest.approx(low, abs=1e-9)
    assert 200 <= np.flatnonzero(found.cusum_high > DECISION)[0] <= 230


def test_the_run_length_is_that_of_simulated_lines() -> None:
    assert run_length() == pytest.approx(465.0, rel=0.03)  # k = 0.5, h = 5: Montgomery, table 9.3


def test_the_weighed_median() -> None:
    assert weighed_median(np.array([3.0, 1.0, 2.0]), np.ones(3)) == 2.0
    assert weighed_median(np.array([1.0, 5.0]), np.array([1.0, 1e9])) == pytest.approx(5.0)


@pytest.mark.parametrize("value", [np.ones(1), np.array([1.0, np.nan])])
def test_what_cannot_be_charted_is_refused(value: np.ndarray) -> None:
    with pytest.raises(ValueError, match="two units or more"):
        chart(names(len(value)), value, np.zeros(len(value)))


def quiet(rng: np.random.Generator, units: int) -> tuple[np.ndarray, np.ndarray]:
    stderr = rng.uniform(0.2, 1.0, units)
    return rng.standard_normal(units) + stderr * rng.standard_normal(units), stderr


def test_a_step_is_found_where_it_is_with_its_size() -> None:
    rng = np.random.default_rng(4)
    series = {f"s_{k}": quiet(rng, 400) for k in range(8)}
    value, stderr = series["s_3"]
    series["s_3"] = (value - np.where(np.arange(400) >= 290, 1.5, 0.0), stderr)
    (found,) = drifts(series)
    assert (found.symbol, found.kind) == ("s_3", "step")
    assert abs(found.since - 290) <= 6
    assert found.size == pytest.approx(-1.5, abs=0.4)
    assert found.size_sd == pytest.approx(-1.5, abs=0.5)


def test_a_trend_is_found_and_a_place_without_a_value_passed_over() -> None:
    rng = np.random.default_rng(5)
    value, stderr = quiet(rng, 300)
    value = value + np.linspace(0.0, 2.0, 300)
    value[::7] = np.nan
    (found,) = drifts({"K_b": (value, stderr)})
    assert found.kind == "trend"
    assert found.size == pytest.approx(2.0, abs=0.5)


def test_two_odd_units_are_no_drift() -> None:
    value, stderr = quiet(np.random.default_rng(6), 200)
    value[[30, 31]] += 60.0
    assert drifts({"K_s": (value, stderr)}) == ()


@pytest.mark.slow
@pytest.mark.parametrize("units", [12, 200])
def test_a_line_without_change_shows_one_as_rarely_as_is_said(units: int) -> None:
    lines, alarms = 400, 0
    for seed in range(lines):
        rng = np.random.default_rng(seed)
        alarms += len(drifts({f"s_{k}": quiet(rng, units) for k in range(2)})) > 0
    assert alarms <= stats.binom.ppf(0.9995, lines, 0.015)


def test_too_few_units_show_no_drift() -> None:
    assert drifts({"K_s": (np.arange(5.0), np.zeros(5))}) == ()
