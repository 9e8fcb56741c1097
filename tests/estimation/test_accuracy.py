"""What the stated accuracy of instruments adds to intervals: against a held plate whose answer is Ohm's law."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import folders
from etcfit.errors import MeasurementError
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.result import FitResult
from etcfit.rig.base import Accuracy, TpsCalibration
from etcfit.rig.config import config_of
from etcfit.rig.reader import read_folder
from etcfit.rig.toml import Toml, parse

VOLTS, OHM, SIGMA = 2.0, 1.513, 0.01
FIXED = {"L_a": 1e-9, "K_b": 0.0189, "J_m": 1e-6, "J_L": 1e-3, "B_m": 1e-5, "B_L": 1e-3, "K_s": 0.15, "T_PL": 0.36}


def of_a_held_plate(path: Path, accuracy: str) -> FitResult:
    """R_a alone is to be told: R = V / i."""
    toml = "\n".join([
        folders.TOML.replace("[rig]", "[rig]\nsynthetic = true"),
        f"[noise]\ncurrent_A = {SIGMA}\nvoltage_V = 1e-6\n{accuracy}\n[parameters]",
        *(f"{symbol} = {{ fixed = {value} }}" for symbol, value in FIXED.items()),
    ])  # fmt: skip
    rng = np.random.default_rng(2)
    time = 0.01 * np.arange(40)
    current = VOLTS / OHM + SIGMA * rng.standard_normal(40)
    sheet = folders.sheet("time [s]", "voltage [V]", "current [A]", columns=(time, VOLTS + 0.0 * time, current))
    return fit(read_folder(folders.write(path, {"rig.toml": toml, "resistance/1.csv": sheet.text()})))


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return of_a_held_plate(tmp_path_factory.mktemp("bare"), "")


@pytest.fixture(scope="module")
def stated(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    limits = '[accuracy]\ncurrent = "1 % + 5 mA"\nvoltage = "20 mV"\nposition = "1 deg"'
    return of_a_held_plate(tmp_path_factory.mktemp("stated"), limits)


def test_without_a_word_of_accuracy_intervals_are_statistical(bare: FitResult) -> None:
    assert bare.budget is None


def test_the_variance_is_that_of_ohms_law(bare: FitResult, stated: FitResult) -> None:
    own, full = intervals(bare)["R_a"].stderr, intervals(stated)["R_a"].stderr
    assert own is not None
    assert full is not None
    amps = VOLTS / OHM
    parts = {"scale of current": OHM * 0.01, "zero of current": OHM * 0.005 / amps, "zero of voltage": 0.02 / amps}
    expected = math.sqrt(own**2 + sum(limit**2 / 3.0 for limit in parts.values()))
    assert full == pytest.approx(expected, rel=0.01)
    assert full > 3.0 * own
    budget = stated.budget
    assert budget is not None
    assert set(budget.sources) == set(parts)  # no position was logged
    column = budget.shares()[:-1, stated.free_parameters.layout.free.index("R_a")]
    shares = dict(zip(budget.sources, column, strict=True))
    for source, limit in parts.items():
        assert shares[source] == pytest.approx(limit**2 / 3.0 / full**2, rel=0.03)


def test_the_estimate_itself_does_not_move(bare: FitResult, stated: FitResult) -> None:
    assert stated.values["R_a"] == pytest.approx(bare.values["R_a"], rel=1e-9)


def test_the_posterior_takes_instruments_as_exact(bare: FitResult, stated: FitResult) -> None:
    np.testing.assert_allclose(stated.taken_as_exact().covariance, bare.covariance, rtol=1e-6)


def read(text: str) -> dict[str, Accuracy]:
    toml = Toml("rig.toml", text, parse(text, "rig.toml"))
    return dict(config_of(toml, "bench").accuracy)


def test_limits_are_read_in_any_unit() -> None:
    found = read('[accuracy]\ncurrent = "1 % + 5 mA"\nposition = "0.5 deg"\ngear = "0.1 %"\nvoltage = "2%"')
    assert found["current"] == Accuracy(pytest.approx(0.01), pytest.approx(0.005))
    assert found["position"] == Accuracy(0.0, pytest.approx(math.radians(0.5)))
    assert found["gear"] == Accuracy(pytest.approx(0.001), 0.0)
    assert found["voltage"] == Accuracy(pytest.approx(0.02), 0.0)


def test_sensor_volts_count_for_a_position() -> None:
    tps = TpsCalibration(0.5, 4.5, math.pi / 2)
    found = read('[tps]\nclosed_V = 0.5\nopen_V = 4.5\ntravel_deg = 90.0\n[accuracy]\nposition = "40 mV"')
    assert found["position"].absolute == pytest.approx(0.04 * tps.travel / 4.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('curent = "1 %"', "Did you mean 'current'"),
        ("current = 0.01", "must be a text"),
        ('current = "1"', "limits with units"),
        ('current = "5 kg"', "not one of current"),
        ('current = "0 %"', "above 0"),
        ('current = "80 %"', "below 50 %"),
        ('gear = "1 V"', "no unit but %"),
    ],
)
def test_what_is_no_accuracy_is_refused(line: str, words: str) -> None:
    with pytest.raises(MeasurementError, match=words) as found:
        read(f"[accuracy]\n{line}")
    assert str(found.value).startswith("rig.toml:2: ")
