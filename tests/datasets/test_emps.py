"""EMPS: the published inverse-model fit comes back out of the converted folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, cheby1, filtfilt

from etcfit.datasets.emps import on_schedule
from etcfit.errors import MeasurementError


@pytest.fixture(scope="module")
def emps(fetched):
    return fetched("emps")


def _filter(design: Any, x: np.ndarray, padlen: int) -> np.ndarray:
    """Zero phase, with as many reflected samples at the edges as MATLAB's `filtfilt` takes."""
    b, a = design
    return filtfilt(b, a, x, padlen=padlen)


def _decimate(x: np.ndarray, factor: int = 10) -> np.ndarray:
    """Every tenth sample after a Chebyshev filter, with the edges and the phase of MATLAB's `decimate`."""
    return _filter(cheby1(8, 0.05, 0.8 / factor), x, padlen=24)[(x.size - 1) % factor :: factor]


def _inverse_model(trace: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Regressors (acceleration, speed, its sign, 1) and force, as in the authors' script.

    Source: Janot, Gautier, Brunot 2019, Script_IDIM_LS. Differs from source: no, its uncut end included.
    """
    q = _filter(butter(4, 100.0, fs=1000.0), trace["position [rad]"].to_numpy(), padlen=12)
    speed = np.gradient(q, 1e-3)
    columns = np.gradient(speed, 1e-3), speed, np.sign(speed), np.ones_like(q), trace["torque [N*m]"].to_numpy()
    *regressors, force = (_decimate(column[49:]) for column in columns)
    return np.column_stack(regressors), force


def _error_percent(regressors: np.ndarray, force: np.ndarray, parameters: np.ndarray) -> float:
    return float(100 * np.linalg.norm(force - regressors @ parameters) / np.linalg.norm(force))


def test_published_inverse_model_to_the_last_printed_digit(emps) -> None:
    regressors, force = _inverse_model(emps.trace("response/training.csv"))
    found, *_ = np.linalg.lstsq(regressors, force, rcond=None)
    assert found == pytest.approx([95.1089, 203.5034, 20.3935, -3.1648], abs=6e-5)
    assert _error_percent(regressors, force, found) == pytest.approx(4.0834, abs=6e-5)
    # the held-out pulses, by the authors' cross-test
    crossed = _error_percent(*_inverse_model(emps.trace("response/pulses.csv")), found)
    assert crossed == pytest.approx(5.9824, abs=6e-5)
    assert emps.rig["holdout"]["files"] == ["response/pulses.csv"]


def test_stated_noise_is_the_encoders(emps) -> None:
    # third differences of a smooth motion leave the noise, times sqrt(20)
    position = emps.trace("response/training.csv")["position [rad]"].to_numpy()
    noise = np.median(np.abs(np.diff(position, 3))) / 0.6745 / np.sqrt(20)
    assert noise == pytest.approx(emps.rig["noise"]["position_rad"], rel=0.1)


def test_only_the_sled_is_free(emps) -> None:
    fixed = {symbol: known["fixed"] for symbol, known in emps.rig["parameters"].items() if isinstance(known, dict)}
    assert fixed == {"K_s": 0.0, "J_m": pytest.approx(0.0, abs=1e-8), "B_m": 0.0}
    assert emps.rig["rig"]["travel_deg"] == [-np.inf, np.inf]


def test_a_file_with_another_clock_is_refused() -> None:
    with pytest.raises(MeasurementError, match=r"0\.001 s apart"):
        on_schedule(Path("DATA_EMPS.mat"), np.array([0.0, 0.001, 0.003]))
