"""Errors of a free run, in the unit that was logged."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.problem.prediction_error import PredictionError, pooled, rows
from etcfit.rig.base import Channel, Measurement
from measurements import channel, prepared

T = np.arange(6) * 1e-3


def test_a_channel_is_scored_in_its_logged_unit_over_the_samples_it_has() -> None:
    degree = np.pi / 180.0
    angle = Channel(T[:4], 0 * T[:4] + 0.3, 0.2 * degree, False, "position", "deg", degree)
    logged = {"voltage": channel(T, 0 * T, 1e-2), "position": angle}
    trace = prepared(Measurement("response/a.csv", "response", T, logged))
    (row,) = rows([trace], [trace.data + 0.5 * degree])
    assert (row.file, row.test, row.channel, row.unit, row.n) == ("response/a.csv", "response", "position", "deg", 4)
    assert row.rms == pytest.approx(0.5)
    assert row.sigma == pytest.approx(0.2)


def test_pooled_counts_each_channel_for_its_samples() -> None:
    """sqrt((3 * 2^2 + 1 * 4^2) / 4) = sqrt 7, whatever the units."""
    each = [PredictionError("a", "t", "c", "V", 3, 0.2, 0.1), PredictionError("b", "t", "c", "deg", 1, 4.0, 1.0)]
    assert pooled(each) == pytest.approx(np.sqrt(7.0))
