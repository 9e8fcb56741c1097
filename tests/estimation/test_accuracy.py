"""What the stated accuracy of instruments adds to intervals: against a held plate whose answer is Ohm's law."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import folders
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.result import FitResult
from etcfit.rig.reader import read_folder

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


@pytest.mark.slow
def test_ends_of_the_sensor_and_the_clock_are_sources_of_their_own(tmp_path: Path) -> None:
    """A resistance test feels neither."""
    result = of_a_held_plate(tmp_path, '[accuracy]\nsensor_end_points = "1 deg"\ntime = "1 %"')
    assert result.budget is not None
    assert result.budget.sources == ("clock",)
    np.testing.assert_allclose(result.budget.moves, 0.0, atol=1e-9)
