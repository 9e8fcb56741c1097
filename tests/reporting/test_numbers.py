"""As many digits as the uncertainty warrants. Errors of many traces as one, each counting for its samples."""

from __future__ import annotations

import math

import pytest

from etcfit.problem.prediction_error import PredictionError
from etcfit.reporting.numbers import Digits, is_share, short
from etcfit.reporting.tables import Pool


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [(1.512123, 0.00031, "1.51212"), (1.512123, 0.2, "1.51"), (0.0014, 0.99996e-5, "0.001400"),
     (1.3822e-6, 4.9e-9, "1.3822e-06"), (20.68, None, "20.68"), (0.0, None, "0.000"), (512345.0, 1234.0, "5.123e+05")],
)  # fmt: skip
def test_two_digits_of_the_spread(value: float, spread: float | None, text: str) -> None:
    assert Digits.of_value(value, spread)(value) == text


def test_both_ends_of_an_interval_have_the_same_digits() -> None:
    assert Digits.of_value(1.5e-6, 1e-8).span(1.48e-6, 1.52e-6) == "1.480e-06 ... 1.520e-06"
    assert Digits.of_value(1.5, 0.01).span(None, None) == "-"


@pytest.mark.parametrize(
    ("value", "text"),
    [(999.99999, "1000"), (0.00123456, "0.00123"), (1.5e-7, "1.50e-07"), (0.0, "0"), (None, "-"), (float("nan"), "-")],
)
def test_short_figures(value: float | None, text: str) -> None:
    assert short(value) == text


def test_a_share_has_a_place_and_no_unit() -> None:
    assert is_share("edge_phase.response", "")
    assert not is_share("series_ohm.inductance", "ohm")
    assert not is_share("mu", "")


def row(n: int, rms: float, sigma: float) -> PredictionError:
    return PredictionError("response/1.csv", "response", "current", "mA", n, rms, sigma)


def test_a_long_trace_counts_for_more_than_a_short_one() -> None:
    found = Pool.of_rows([row(300, 1.0, 1.0), row(100, 3.0, 2.0)])
    assert (found.traces, found.samples) == (2, 400)
    assert found.rms == pytest.approx(math.sqrt((300 * 1.0 + 100 * 9.0) / 400))
    assert found.sigma == pytest.approx(math.sqrt((300 * 1.0 + 100 * 4.0) / 400))
    assert found.ratio == pytest.approx(math.sqrt((300 * 1.0 + 100 * 2.25) / 400))
