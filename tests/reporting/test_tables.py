"""What the commands print."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import results
from etcfit.estimation.identifiability import Identifiability
from etcfit.estimation.joint_fit import FitResult
from etcfit.experiment.check import ChannelCheck, CheckResult, Clock, TraceCheck
from etcfit.reporting.blocks import plain_table
from etcfit.reporting.check_table import check_table
from etcfit.reporting.tables import fit_table, render


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m", "J_L"))


def line(text: str, word: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(word))


def test_fit_table_holds_reading_fit_interval_unit_and_status(fitted: FitResult) -> None:
    text = render(fit_table(fitted))
    r = line(text, "R_a")
    assert "1.513" in r  # the nominal value it was put at
    assert "..." in r
    assert "ohm" in r
    assert "estimated" in r
    assert "tied (K_m = K_b)" in line(text, "K_m")
    assert "fixed" in line(text, "B_m")
    assert "not identifiable" in line(text, "J_L")
    assert "1.400e-06" not in line(text, "J_m"), "a value that the data do not determine is not shown as one"


def test_fit_table_says_synthetic_where_so_and_not_where_not(fitted: FitResult, tmp_path: Path) -> None:
    assert "SYNTHETIC DATA" in render(fit_table(fitted))
    assert "SYNTHETIC" not in render(fit_table(results.result(results.rig(tmp_path, synthetic=False))))


def test_fit_table_holds_scores_cures_starts_and_warnings(fitted: FitResult) -> None:
    text = render(fit_table(fitted))
    assert "held-out traces" in text
    assert "J_m and J_L are seen only as N^2 J_m + J_L" in text
    assert "scattered 1" in text
    assert "something is odd" in text
    assert "Converged: gradient zero" in text
    failed = render(fit_table(replace(fitted, converged=False, reason="the gradient [sic] is not zero")))
    assert "NOT CONVERGED: the gradient [sic] is not zero" in failed


def test_scores_are_pooled_by_test_and_channel(fitted: FitResult) -> None:
    row = next(r for r in fitted.score_fit if r.channel == "current")
    same = (replace(row, n=100, rms=3.0, sigma=1.0), replace(row, n=300, rms=1.0, sigma=1.0, file="b"))
    text = render(fit_table(replace(fitted, score_fit=same, score_holdout=())))
    assert f"{np.sqrt((100 * 9 + 300) / 400):.2f}" in line(text, row.test)
    assert " 400 " in line(text, row.test)


def test_check_table_lists_what_is_odd(fitted: FitResult) -> None:
    tps = ChannelCheck("position", "V", 0.44, 5.0, 0.003, True, 0.00122, 3, 120, False)
    current = ChannelCheck("current", "mA", 7.0, 7.0, 0.1, False, 0.0, 0, 0, True)
    trace = TraceCheck("response/1.csv", "response", True, Clock(500, 0.5, 1000.0, 0.012, 2, 0.02), (tps, current))
    verdict = Identifiability(("R_a",), np.array([12.0]), (), np.eye(1), ("R_a",))
    text = render(
        check_table(CheckResult(fitted.rig, (trace,), verdict, ("R_a is hardly seen.",), None, ("a stray file",)))
    )
    assert "held out" in line(text, "response/1.csv")
    assert "2, longest 0.0200 s" in line(text, "response/1.csv")
    assert "1.2" in line(text, "response/1.csv")
    for words in ("position rests on", "120 samples", "3 empty cells", "current never changes", "a stray file"):
        assert words in text
    assert "not identifiable: R_a" in text
    assert "estimated" in line(text, "response  position")
    assert "given" in line(text, "response  current")


def test_check_table_says_that_nothing_can_be_fitted(fitted: FitResult) -> None:
    text = render(check_table(CheckResult(fitted.rig, (), None, (), None, (), "bench has no trace.")))
    assert "Nothing can be fitted" in text
    assert "bench has no trace." in text


def test_a_name_with_its_place_in_brackets_is_no_style() -> None:
    table = plain_table("effect", "BIC")
    table.add_row("channel_gain[response.current]", "-12 [V]")
    assert "channel_gain[response.current]  -12 [V]" in render(table)
