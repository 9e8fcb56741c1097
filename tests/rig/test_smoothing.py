"""Local parabolas and low passes against SciPy, which they stand in for."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import butter, cheby1, savgol_filter, sosfiltfilt

from etcfit.rig.smoothing import LowPass, butterworth, chebyshev, slope, smoothed


@pytest.mark.parametrize(("samples", "window"), [(50, 7), (21, 21), (400, 5), (33, 31)])
def test_it_is_what_scipy_makes(samples: int, window: int) -> None:
    y = np.random.default_rng(window).standard_normal(samples)
    assert_allclose(smoothed(y, window), np.asarray(savgol_filter(y, window, 2)), atol=1e-12)
    assert_allclose(slope(y, window, 0.01), np.asarray(savgol_filter(y, window, 2, deriv=1, delta=0.01)), atol=1e-9)


def test_a_parabola_is_left_as_it_is_up_to_its_ends() -> None:
    t = np.linspace(-1.0, 2.0, 31)
    assert_allclose(smoothed(3.0 * t**2 - t, 9), 3.0 * t**2 - t, atol=1e-12)
    assert_allclose(slope(3.0 * t**2 - t, 9, 0.1), 6.0 * t - 1.0, atol=1e-10)


FILTERS = {
    "butterworth": (lambda cutoff: butterworth(4, cutoff), lambda cutoff: butter(4, cutoff, output="sos")),
    "chebyshev": (lambda cutoff: chebyshev(8, 0.05, cutoff), lambda cutoff: cheby1(8, 0.05, cutoff, output="sos")),
}


def walk(*shape: int) -> np.ndarray:
    """A signal far from 0 that does not end where it began."""
    return 3.0 + np.cumsum(np.random.default_rng(1).normal(size=shape), axis=0)


@pytest.mark.parametrize("cutoff", [0.004, 0.02, 0.1, 0.4, 0.8])
@pytest.mark.parametrize("shape", [(52,), (64,), (1000,), (5001, 3)], ids=str)
@pytest.mark.parametrize("name", FILTERS)
def test_it_filters_as_scipy_does(name: str, cutoff: float, shape: tuple[int, ...]) -> None:
    ours, theirs = FILTERS[name]
    x = walk(*shape)
    expected = sosfiltfilt(theirs(cutoff), x, axis=0)
    assert np.abs(ours(cutoff)(x) - expected).max() < 1e-10 * np.abs(expected).max()


def passed(low_pass: LowPass, frequency: float) -> float:
    """Amplitude of a sine behind the filter, ends left out."""
    sine = np.sin(np.pi * frequency * np.arange(4000))
    return float(np.abs(low_pass(sine)[500:-500]).max())


def test_a_butterworth_passes_half_at_its_cutoff_for_it_is_run_twice() -> None:
    assert passed(butterworth(4, 0.1), 0.1) == pytest.approx(0.5, rel=1e-3)
    assert passed(butterworth(4, 0.1), 0.02) == pytest.approx(1.0, rel=1e-4)


def test_a_chebyshev_stays_within_its_ripple_and_is_steeper() -> None:
    low_pass = chebyshev(8, 0.05, 0.1)
    assert low_pass.gain == pytest.approx(10 ** (-0.05 / 20))
    assert passed(low_pass, 0.1) == pytest.approx(10 ** (-2 * 0.05 / 20), rel=1e-3)
    assert passed(low_pass, 0.2) < 1e-3 * passed(butterworth(4, 0.1), 0.2)


def test_too_few_samples_are_refused() -> None:
    low_pass = chebyshev(8, 0.05, 0.1)
    with pytest.raises(ValueError, match="more than 27 samples"):
        low_pass(np.zeros(low_pass.pad))
    assert low_pass(np.ones(low_pass.pad + 1)) == pytest.approx(np.full(low_pass.pad + 1, low_pass.gain**2))
