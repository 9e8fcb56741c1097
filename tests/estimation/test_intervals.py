"""Standard errors and intervals against closed forms, domain by domain."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import folders
import results
from etcfit.estimation.agreement import Compromise
from etcfit.estimation.intervals import intervals, lumped
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.rig.reader import read_folder

SD = 0.02


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")))


def moved(result: FitResult, symbol: str, value: float) -> FitResult:
    """The same with one parameter elsewhere."""
    layout = result.free_parameters.layout
    x = result.x.copy()
    x[layout.free.index(symbol)] = layout.parameter(symbol).domain.coordinate(value)
    values = {s: float(v) for s, v in layout.values(x, result.free_parameters.held).items()}
    return replace(result, x=x, values=values)


def test_log_domain_is_asymmetric_by_the_exponential(fitted: FitResult) -> None:
    r = intervals(moved(fitted, "R_a", 1.5))["R_a"]
    assert (r.value, r.stderr) == (pytest.approx(1.5), pytest.approx(1.5 * SD))
    assert (r.low, r.high) == (pytest.approx(1.5 * np.exp(-1.96 * SD)), pytest.approx(1.5 * np.exp(1.96 * SD)))
    assert r.high - r.value > r.value - r.low  # pyright: ignore
    assert r.status == "estimated"


def test_linear_domain_is_symmetric(fitted: FitResult) -> None:
    layout = fitted.free_parameters.layout
    scale = layout.parameter("K_s").domain.scale  # pyright: ignore[reportAttributeAccessIssue]
    k = intervals(moved(fitted, "K_s", 50.0 * scale))["K_s"]  # far from zero the bend of 0.02 is 4e-8
    assert k.stderr == pytest.approx(scale * SD, rel=1e-6)
    assert (k.low, k.high) == (pytest.approx(k.value - 1.96 * scale * SD), pytest.approx(k.value + 1.96 * scale * SD))


def test_an_interval_never_crosses_zero_and_the_bound_is_named(fitted: FitResult) -> None:
    k = fitted.free_parameters.layout.free.index("T_f")
    x, covariance = fitted.x.copy(), fitted.covariance.copy()
    x[k], covariance[k, k] = -0.2, 0.3**2
    value = float(fitted.free_parameters.layout.parameter("T_f").domain.value(x[k]))
    t = intervals(replace(fitted, x=x, values={**fitted.values, "T_f": value}, covariance=covariance))["T_f"]
    assert t.remark == "at its bound"
    assert 0.0 < t.low < t.value < t.high  # pyright: ignore


def test_fixed_tied_and_the_gear_ratio(fitted: FitResult) -> None:
    every = intervals(fitted)
    assert (every["B_m"].value, every["B_m"].stderr, every["B_m"].low, every["B_m"].status) == (
        2e-5,
        None,
        None,
        "fixed",
    )
    assert every["K_m"].status == "tied"
    assert (every["K_m"].stderr, every["K_m"].low) == (every["K_b"].stderr, every["K_b"].low)
    assert (every["N"].value, every["N"].status, every["N"].remark) == (20.68, "fixed", None)


def test_what_is_lost_has_no_interval_and_takes_its_ties_along(fitted: FitResult) -> None:
    every = intervals(replace(fitted, identifiability=replace(fitted.identifiability, lost=("K_b",))))
    for symbol in ("K_b", "K_m"):
        assert (every[symbol].status, every[symbol].stderr, every[symbol].high) == ("not identifiable", None, None)
    assert every["R_a"].status == "estimated"


def test_a_widened_interval_that_says_nothing_is_no_interval(fitted: FitResult) -> None:
    covariance = fitted.covariance.copy()
    covariance[0, 0] = 3.0
    symbol = fitted.free_parameters.layout.free[0]
    assert intervals(replace(fitted, covariance=covariance))[symbol].status == "not identifiable"


def test_a_covariance_that_is_no_number_gives_none(fitted: FitResult) -> None:
    broken = intervals(replace(fitted, covariance=np.full_like(fitted.covariance, np.nan)))
    assert broken["R_a"].stderr is None
    assert "could not be computed" in (broken["R_a"].remark or "")


def test_lumped_inertia_by_the_delta_method(fitted: FitResult) -> None:
    layout = fitted.free_parameters.layout
    m, load = layout.free.index("J_m"), layout.free.index("J_L")
    covariance = fitted.covariance.copy()
    covariance[m, load] = covariance[load, m] = -0.5 * SD**2
    slope_motor, slope_load = 20.68**2 * _slope(fitted, "J_m"), _slope(fitted, "J_L")
    variance = SD**2 * (slope_motor**2 + slope_load**2 - slope_motor * slope_load)
    j = lumped(replace(fitted, covariance=covariance))["J_eq"]
    assert j.value == pytest.approx(20.68**2 * fitted.values["J_m"] + fitted.values["J_L"])
    assert j.stderr == pytest.approx(np.sqrt(variance), rel=1e-6)


N = 20.68
VOLTS = {  # what holds and brakes the plate, at the terminals
    "V_PL": lambda v: v["T_PL"] * v["R_a"] / (N * v["K_m"]),
    "V_f": lambda v: v["T_f"] * v["R_a"] / (N * v["K_m"]),
    "V_s": lambda v: v["K_s"] * v["R_a"] / (N * v["K_m"]),
    "V_w": lambda v: (N**2 * v["B_m"] + v["B_L"]) * v["R_a"] / (N * v["K_m"]) + N * v["K_b"],
    "B_eq": lambda v: N**2 * v["B_m"] + v["B_L"],
}


@pytest.mark.parametrize("symbol", VOLTS)
def test_a_combination_and_its_error_are_those_of_its_formula(fitted: FitResult, symbol: str) -> None:
    lump, layout, held = VOLTS[symbol], fitted.free_parameters.layout, fitted.free_parameters.held
    braking, h = moved(fitted, "B_L", 2e-3), 1e-5
    slopes = [
        (lump(layout.values(braking.x + h * e, held)) - lump(layout.values(braking.x - h * e, held))) / (2.0 * h)
        for e in np.eye(braking.x.size)
    ]
    found = lumped(braking)[symbol]
    assert found.stderr is not None
    assert found.value == pytest.approx(lump(braking.values))
    assert found.stderr == pytest.approx(SD * np.linalg.norm(slopes), rel=1e-6)
    assert (found.low, found.high) == (pytest.approx(found.value - 1.96 * found.stderr),
                                       pytest.approx(found.value + 1.96 * found.stderr))  # fmt: skip


def test_a_combination_that_is_not_known_has_no_range_in_a_compromise_either(fitted: FitResult) -> None:
    none = replace(fitted, covariance=np.full_like(fitted.covariance, np.nan))
    given = Compromise("why", ("one",), fitted.x[None], fitted.covariance[None], np.full((1, fitted.x.size), np.nan))
    assert lumped(replace(none, compromise=given))["J_eq"].status == "not identifiable"
    known = lumped(replace(fitted, compromise=given))["J_eq"]
    assert (known.status, known.stderr) == ("compromise", None)


def _slope(result: FitResult, symbol: str, h: float = 1e-5) -> float:
    """dvalue/dx by differences."""
    layout = result.free_parameters.layout
    domain, x = layout.parameter(symbol).domain, float(result.x[layout.free.index(symbol)])
    return float(domain.value(x + h) - domain.value(x - h)) / (2 * h)


# ---- What the stated accuracy of instruments adds to intervals: against a held plate whose answer is Ohm's law

HELD_VOLTS, OHM, SIGMA = 2.0, 1.513, 0.01
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
    current = HELD_VOLTS / OHM + SIGMA * rng.standard_normal(40)
    sheet = folders.sheet("time [s]", "voltage [V]", "current [A]", columns=(time, HELD_VOLTS + 0.0 * time, current))
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
    amps = HELD_VOLTS / OHM
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
