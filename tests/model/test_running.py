"""Running sums and maxima are those of NumPy."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.model.delay import running_max, running_sum


def test_they_are_those_of_numpy_along_the_first_axis() -> None:
    x = np.random.default_rng(0).standard_normal((50, 3))
    assert_allclose(running_sum(x), np.cumsum(x, axis=0), rtol=1e-12)
    assert_array_equal(running_max(x), np.maximum.accumulate(x, axis=0))
