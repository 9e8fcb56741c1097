"""Standard errors of units: none surer than the middle unit, none widened beyond what the others are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.fleets.statistics.robust import robust
from fleet_works import result_of

WIDENED = (1.0, 1.5, 1.5, 2.0, 40.0)  # the middle unit's is 1.5


@pytest.mark.parametrize(("most", "expected"), [(3.0, (1.5, 1.5, 1.5, 2.0, 4.5)), (1.0, (1.5,) * 5)])
def test_each_is_widened_as_it_says_within_the_middle_units_and_so_many_times_it(
    most: float, expected: tuple[float, ...]
) -> None:
    units = [replace(result_of(f"u{k}"), widening={"R_a": w}) for k, w in enumerate(WIDENED)]
    for unit, by, found in zip(units, expected, robust(units, most), strict=True):
        scale = np.array([by, 1.0])  # K_b says nothing of being widened
        np.testing.assert_allclose(found.information, unit.own.information / np.outer(scale, scale), rtol=1e-12)
        np.testing.assert_array_equal(found.estimate, unit.own.estimate)
