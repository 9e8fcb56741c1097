"""Logs of setpoint and position under an ECU, without any bench test: what they tell, and what they cannot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bank import under_ecu as bank
from ecu_folders import FREE, KNOWN, under_ecu
from etcfit.estimation.intervals import intervals, lumped
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.experiment.check import CheckResult, check
from etcfit.rig.paper_readings import read_graphs
from etcfit.rig.reader import read_folder
from independent import draw_truth


def test_known_gains_read_the_plate_but_for_what_the_integral_hides(tmp_path: Path) -> None:
    truth, rig = under_ecu(tmp_path, 4, KNOWN, problem=False)
    read = read_graphs(rig)
    assert "T_PL" not in read.values
    # the scale is nominal; friction in volts is not
    volts = read.values["T_f"] * read.values["R_a"] / (truth.N * read.values["K_b"])
    assert volts == pytest.approx(truth.volts_for(truth.T_f), rel=0.35)


@pytest.fixture(scope="module")
def with_free_gains(tmp_path_factory: pytest.TempPathFactory) -> CheckResult:
    return check(under_ecu(tmp_path_factory.mktemp("rig"), 4, FREE, problem=False)[1])


@pytest.mark.slow
def test_check_says_what_one_known_gain_would_tell(with_free_gains: CheckResult) -> None:
    found = with_free_gains
    assert found.identifiability is not None
    assert {"K_p", "K_i", "K_d", "T_PL", "K_s"} <= set(found.identifiability.lost)
    assert any("none of its gains is known" in text for text in found.directions)
    assert any(text.startswith("Were K_p ([ecu] P) known, ") and "K_i and K_d" in text for text in found.gains)


@pytest.mark.slow
def test_where_known_gains_leave_a_symbol_open_free_ones_do_too(with_free_gains: CheckResult, tmp_path: Path) -> None:
    known = check(under_ecu(tmp_path, 4, KNOWN, problem=False)[1]).identifiability
    free = with_free_gains.identifiability
    assert known is not None
    assert free is not None
    assert {*known.lost, "K_p", "K_i", "K_d", "V_e"} <= set(free.lost)


def in_volts_it_is_true(result: FitResult, true: dict[str, float]) -> None:
    """Friction, stiffness and drag in volts, within four standard errors of their own."""
    found = lumped(result)
    for symbol in ("V_f", "V_s", "V_w"):
        stderr = found[symbol].stderr
        assert stderr, f"{symbol} has no standard error"
        assert abs(found[symbol].value - true[symbol]) < 4.0 * stderr, symbol


Fitted = Callable[[str, int], tuple[dict[str, float], FitResult]]


@pytest.fixture
def steps_and_ramps(tmp_path: Path) -> Fitted:
    """Two short logs of the benchmark, fitted with the gains told as a case says; the truth in volts beside it."""

    def fitted(case: str, seed: int) -> tuple[dict[str, float], FitResult]:
        truth = draw_truth(np.random.default_rng(seed))
        bank.write(tmp_path / "rig", truth, seed, case)
        return bank.in_volts(truth) | bank.GAINS, fit(read_folder(tmp_path / "rig"))

    return fitted


@pytest.mark.slow
def test_steps_that_a_slow_log_places_badly_bias_nothing(steps_and_ramps: Fitted) -> None:
    """Steps seen by an ECU of 1 ms in a log at 500 Hz, slow ramps beside them; training seed. No torque is told."""
    true, result = steps_and_ramps("known", 17003)
    assert result.converged, result.reason
    assert result.chi2_per_dof < 1.25  # 3 when each step was a ramp between two samples
    assert {"R_a", "K_b", "K_s", "T_f", "J_m", "J_L"} <= set(result.identifiability.lost)
    in_volts_it_is_true(result, true)
    found = lumped(result)
    assert all((found[symbol].stderr or np.inf) < 0.05 * true[symbol] for symbol in ("V_f", "V_s", "V_w"))


@pytest.mark.slow
def test_gains_that_nobody_knows_tell_ratios_and_no_volts(steps_and_ramps: Fitted) -> None:
    """All that has no scale is called so by name; the ratios are within 3 %."""
    true, result = steps_and_ramps("free", 17000)
    stated = {**lumped(result), **intervals(result)}
    for symbol in ("V_f", "V_s", "V_w", "V_PL", "K_p", "K_i", "K_d", "T_f", "K_s", "T_PL"):
        assert stated[symbol].status == "not identifiable", symbol
    scale = stated["V_f"].value / true["V_f"]
    for symbol in ("V_s", "V_w", "K_p", "K_i", "K_d"):
        assert stated[symbol].value == pytest.approx(scale * true[symbol], rel=0.03)


@pytest.mark.slow
def test_ramps_tell_no_preload(tmp_path: Path) -> None:
    """Of which the integral bears whatever it is: the fit says so instead of stating a value."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bank, "LOGS", ("ramps", "ramps"))
        truth = draw_truth(np.random.default_rng(17001))
        bank.write(tmp_path / "rig", truth, 17001, "known")
    result = fit(read_folder(tmp_path / "rig"))
    in_volts_it_is_true(result, bank.in_volts(truth))
    assert lumped(result)["V_PL"].status == "not identifiable"
