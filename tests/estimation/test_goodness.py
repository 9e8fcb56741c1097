"""Whether a channel fits: by the size and independence of its residual, and by its free run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.signal import lfilter

import results
from etcfit.estimation.goodness import (
    STRAYS,
    Goodness,
    Left,
    autocorrelation,
    goodness_of,
    inflation,
    ljung_box,
    warnings_of,
    widen,
    worst,
)
from etcfit.problem.prediction_error import PredictionError
from etcfit.problem.trace import Trace
from etcfit.reporting.pictures import all_traces


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    every = all_traces(results.result(results.rig(tmp_path_factory.mktemp("rig"))))
    return next(each for each in every if each.test.name == "inductance")


def of(trace: Trace, r: np.ndarray, free: float = 1.0) -> Goodness:
    """Of the trace's one channel, its residual r, shape (n,)."""
    (channel,) = trace.channels
    row = PredictionError(trace.measurement.file, trace.test.name, channel, "A", r.size, 0.01 * free, 0.01)
    (found,) = goodness_of([trace], [r[:, None]], [row])
    return found


def white(trace: Trace) -> np.ndarray:
    r = np.random.default_rng(3).standard_normal(trace.instants.size)
    return r / np.sqrt(np.mean(r**2))


def test_the_size_of_the_residual_decides_and_few_samples_may_scatter(trace: Trace) -> None:
    r = white(trace)
    limit = 4.0 * np.sqrt(2.0 / r.size)
    sizes = {1.0: Left.FITS, 1.0 + 0.9 * limit: Left.FITS, 1.0 + 1.1 * limit: Left.MORE, 50.0: Left.FAR}
    assert {size: of(trace, np.sqrt(size) * r).left for size in sizes} == sizes
    assert of(trace, 5.0 * r).rms == pytest.approx(5.0)
    assert of(trace, np.full(r.size, np.nan)).left is Left.FAR
    assert of(trace, np.full(r.size, np.nan)).off == np.inf


def test_a_residual_that_is_not_independent_is_more_than_noise(trace: Trace) -> None:
    slow = np.sin(np.linspace(0.0, 9.0, trace.instants.size))
    found = of(trace, slow)
    assert (found.left, found.correlated) == (Left.MORE, True)
    assert inflation(slow) > 1.0  # what widens the intervals
    assert "not independent" in found.says


def test_noise_whose_free_run_is_far_off_strays(trace: Trace) -> None:
    assert of(trace, white(trace), STRAYS).left is Left.FITS
    found = of(trace, white(trace), 1.1 * STRAYS)
    assert found.left is Left.STRAYS
    assert found.off == pytest.approx(1.1 * STRAYS)
    assert of(trace, white(trace)).says == ""


def test_the_worst_is_of_the_worst_kind_and_then_the_furthest_off(trace: Trace) -> None:
    every = [of(trace, white(trace), free) for free in (1.0, 10.0, 20.0)]
    loud = of(trace, 1.38 * white(trace))
    assert worst(every) is every[2]
    assert worst([*every, loud]) is loud


def test_each_kind_is_counted_in_a_warning_of_its_own(trace: Trace) -> None:
    fits, strays, more = of(trace, white(trace)), of(trace, white(trace), 10.0), of(trace, 1.38 * white(trace))
    assert warnings_of([fits, fits], 1.0) == []
    said = warnings_of([fits, strays, more, more], 2.5)
    assert said[0].startswith("2 of 4 residuals are larger than their noise or not independent")
    assert "up to 2.5 times" in said[0]
    assert said[1].startswith("1 of 4 residuals is noise from sample to sample, but the free run strays")
    assert "10 times the noise" in said[1]


@pytest.mark.parametrize(
    ("widest", "said"),
    [
        (1.0, "No interval becomes wider by 5 %"),
        (1.049, "No interval becomes wider by 5 %"),
        (1.051, "Intervals are widened for it (up to 1.1 times)"),
        (2.34, "Intervals are widened for it (up to 2.3 times)"),
    ],
)
def test_an_interval_that_was_not_widened_is_not_said_to_be(widest: float, said: str, trace: Trace) -> None:
    (words,) = warnings_of([of(trace, 1.38 * white(trace))], widest)
    assert said in words
    assert "1.0 times" not in words


def test_what_a_row_of_a_file_says_is_the_same_rule(tmp_path: Path) -> None:
    from etcfit.run_folder.fit import score_of

    result = results.result(results.rig(tmp_path), off=0.6)
    written = {(row["file"], row["channel"]): row["left"] for row in score_of(result)["fit"]}
    assert written == {(each.file, each.channel): each.left for each in result.goodness}
    assert len(set(written.values())) > 1


# ---- Residuals that are not independent are noticed, and intervals widened by as much as they lied


def coloured(rho: float, n: int, seed: int) -> np.ndarray:
    """Stationary AR(1) of unit variance."""
    rng = np.random.default_rng(seed)
    w = np.sqrt(1.0 - rho**2) * rng.standard_normal(n)
    w[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -rho], w))


def test_autocorrelation_of_an_ar_1() -> None:
    assert_allclose(autocorrelation(coloured(0.6, 200_000, 0), 4), 0.6 ** np.arange(1, 5), atol=0.02)


def test_a_constant_has_no_correlation() -> None:
    assert_array_equal(autocorrelation(np.ones(50), 3), 0.0)
    assert inflation(np.zeros(500)) == 1.0


def test_it_does_not_depend_on_the_size_of_the_residual() -> None:
    r = coloured(0.6, 100, 0)
    assert_allclose(autocorrelation(1e-6 * r, 4), autocorrelation(r, 4))


def test_ljung_box_is_its_formula() -> None:
    """Of few samples, where n + 2 and n - k are not n."""
    r, n, lags = coloured(0.2, 30, 3), 30, 8
    around = r - r.mean()
    rho = [around[k:] @ around[:-k] / (around @ around) for k in range(1, lags + 1)]
    q = n * (n + 2) * sum(rho[k - 1] ** 2 / (n - k) for k in range(1, lags + 1))
    assert ljung_box(r, lags) == pytest.approx(stats.chi2.sf(q, lags))


def test_ljung_box_is_uniform_for_white_residuals() -> None:
    p = np.array([ljung_box(coloured(0.0, 500, seed)) for seed in range(400)])
    assert_allclose(np.quantile(p, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.07)


def test_white_residuals_are_left_alone() -> None:
    assert [inflation(coloured(0.0, 2000, seed)) for seed in range(200)].count(1.0) >= 198


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9])
def test_an_ar_1_inflates_as_its_sum_does(rho: float) -> None:
    """Variance of a sum: (1 + rho)/(1 - rho)."""
    found = np.mean([inflation(coloured(rho, 10_000, seed)) for seed in range(20)])
    assert found == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.15)


def test_residuals_larger_than_their_noise_inflate_by_their_square() -> None:
    assert inflation(3.0 * coloured(0.0, 4000, 1)) == pytest.approx(9.0, rel=0.1)
    assert inflation(0.5 * coloured(0.0, 4000, 1)) == 1.0  # an estimate of the noise that was too large narrows nothing


def test_alternating_residuals_narrow_nothing() -> None:
    assert inflation(coloured(-0.6, 4000, 0)) >= 1.0


def test_too_few_samples_say_nothing() -> None:
    assert inflation(coloured(0.9, 40, 0)) == 1.0


# ---- intervals


def test_widening_is_the_sandwich() -> None:
    """C' = C + C (sum (f - 1) J^T J) C for the pieces that need it."""
    rng = np.random.default_rng(0)
    good, bad = rng.standard_normal((2000, 2)), rng.standard_normal((2000, 2))
    covariance = np.linalg.inv(good.T @ good + bad.T @ bad)
    white, loud = coloured(0.0, 2000, 1), 2.0 * coloured(0.0, 2000, 2)
    wide, factor, count = widen(covariance, [(good, white), (bad, loud)])
    assert count == 1
    expected = covariance + (np.mean(loud**2) - 1.0) * covariance @ bad.T @ bad @ covariance
    assert_allclose(wide, expected, rtol=1e-9)
    assert_allclose(factor, np.sqrt(np.diag(expected) / np.diag(covariance)), rtol=1e-9)


def test_nothing_to_widen_changes_nothing() -> None:
    J = np.ones((500, 1))
    wide, factor, count = widen(np.array([[1 / 500]]), [(J, coloured(0.0, 500, 3))])
    assert (wide[0, 0], factor[0], count) == (1 / 500, 1.0, 0)


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_widened_intervals_cover_where_the_others_do_not(rho: float) -> None:
    """A level and a slope fitted to AR(1) noise: the widened covariance is that of the estimates over 400 seeds."""
    n = 2000
    J = np.stack((np.ones(n), np.linspace(-1.0, 1.0, n)), axis=-1)
    covariance = np.linalg.inv(J.T @ J)
    estimates, stated = [], []
    for seed in range(400):
        noise = coloured(rho, n, seed)
        estimate = covariance @ J.T @ noise
        wide, _, _ = widen(covariance, [(J, noise - J @ estimate)])
        estimates.append(estimate)
        stated.append(np.diag(wide))
    actual = np.mean(np.square(estimates), axis=0)
    assert np.all(actual > 2.5 * np.diag(covariance))
    assert_allclose(actual / np.mean(stated, axis=0), 1.0, atol=0.25)
