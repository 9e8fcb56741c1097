"""Logs from the car in a notebook."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import car_logs
import etcfit
from etcfit.errors import UsageError

HEADERS = {"time": "time [s]", "position": "position [%]", "setpoint": "setpoint [%]"}


def test_logs_are_a_row_each(tmp_path: Path) -> None:
    for name, lag in {"a.csv": 0.08, "b.csv": 0.04}.items():
        (tmp_path / name).write_text(car_logs.csv(car_logs.drive(lag=lag), HEADERS), encoding="utf-8")
    driven = etcfit.drive(tmp_path)
    assert list(driven.table.index) == ["a.csv", "b.csv"]
    np.testing.assert_allclose(driven.table["lag_s"], [0.08, 0.04], atol=0.005)
    assert set(map(str, driven.table.dtypes)) == {"float64"}
    assert "RMSE" in driven.verdict
    assert len(repr(driven)) < 1500
    assert "a.csv" in driven._repr_html_()
    assert len(driven.plot("a.csv")) == 3
    assert list(etcfit.drive(tmp_path, compare=("b.csv", "a.csv")).table.index) == ["b.csv", "a.csv"]
    with pytest.raises(UsageError, match=r"a\.csv, b\.csv"):
        driven.plot("c.csv")
