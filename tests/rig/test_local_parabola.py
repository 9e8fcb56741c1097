"""Local parabolas against SciPy's filter, which they stand in for, and against a parabola."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import savgol_filter

from etcfit.rig.local_parabola import slope, smoothed


@pytest.mark.parametrize(("samples", "window"), [(50, 7), (21, 21), (400, 5), (33, 31)])
def test_it_is_what_scipy_makes(samples: int, window: int) -> None:
    y = np.random.default_rng(window).standard_normal(samples)
    assert_allclose(smoothed(y, window), np.asarray(savgol_filter(y, window, 2)), atol=1e-12)
    assert_allclose(slope(y, window, 0.01), np.asarray(savgol_filter(y, window, 2, deriv=1, delta=0.01)), atol=1e-9)


def test_a_parabola_is_left_as_it_is_up_to_its_ends() -> None:
    t = np.linspace(-1.0, 2.0, 31)
    assert_allclose(smoothed(3.0 * t**2 - t, 9), 3.0 * t**2 - t, atol=1e-12)
    assert_allclose(slope(3.0 * t**2 - t, 9, 0.1), 6.0 * t - 1.0, atol=1e-10)
