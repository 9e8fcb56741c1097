"""Forms in which textbooks write a PID, against the sum that all of them stand for."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.control.pid.gains import Gains

S = 1j * np.geomspace(0.1, 100.0, 7)  # 1/s


@pytest.mark.parametrize(("k", "ti", "td"), [(3.0, 0.5, 0.05), (0.2, 4.0, 1.0)])
def test_standard_and_series_form_are_the_sum_of_three_terms(k: float, ti: float, td: float) -> None:
    def total(gains: Gains) -> np.ndarray:
        return np.asarray(gains.Kp + gains.Ki / S + gains.Kd * S)

    assert_allclose(total(Gains.standard(k, ti, td)), k * (1.0 + 1.0 / (ti * S) + td * S), rtol=1e-12)
    assert_allclose(total(Gains.series(k, ti, td)), k * (1.0 + 1.0 / (ti * S)) * (1.0 + td * S), rtol=1e-12)
