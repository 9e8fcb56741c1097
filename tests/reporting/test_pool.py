"""Errors of many traces as one, each counting for its samples."""

from __future__ import annotations

import math

import pytest

from etcfit.problem.prediction_error import PredictionError
from etcfit.reporting.pool import Pool


def row(n: int, rms: float, sigma: float) -> PredictionError:
    return PredictionError("response/1.csv", "response", "current", "mA", n, rms, sigma)


def test_a_long_trace_counts_for_more_than_a_short_one() -> None:
    found = Pool.of([row(300, 1.0, 1.0), row(100, 3.0, 2.0)])
    assert (found.traces, found.samples) == (2, 400)
    assert found.rms == pytest.approx(math.sqrt((300 * 1.0 + 100 * 9.0) / 400))
    assert found.sigma == pytest.approx(math.sqrt((300 * 1.0 + 100 * 4.0) / 400))
    assert found.ratio == pytest.approx(math.sqrt((300 * 1.0 + 100 * 2.25) / 400))
