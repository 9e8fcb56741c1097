"""What the commands print. Influence, contradictions and compromises as a person sees them: table, page and caution."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import results
import runs
from etcfit.api.fit import Fit
from etcfit.estimation.agreement import Compromise, Influence, Pull
from etcfit.estimation.contradiction import Contradiction
from etcfit.estimation.identifiability import Identifiability
from etcfit.estimation.joint_fit import FitResult
from etcfit.experiment.check import ChannelCheck, CheckResult, Clock, TraceCheck
from etcfit.reporting.blocks import PlainTable, cautioned, render
from etcfit.reporting.check_table import check_table
from etcfit.reporting.page import write_page
from etcfit.reporting.table import of_texts
from etcfit.reporting.tables import fit_table
from etcfit.run_folder.fit import fit_json


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
    assert "held out" in text
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
    table = PlainTable(of_texts("", ("effect", "BIC"), [("channel_gain[response.current]", "-12 [V]")]))
    assert "channel_gain[response.current]  -12 [V]" in render(table)


PULLS = (
    Pull("inductance", None, "L_a", -34.0, -0.6),
    Pull("inductance", "inductance/1.csv", "L_a", -20.0, -0.4),
    Pull("response", None, "R_a", 0.9, 0.01),
    Pull("response", "response/1.csv", "K_b", 0.2, 0.01),
)


@pytest.fixture(scope="module")
def pulled(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    """Two tests that pull, one of which contradicts the others."""
    result = results.result(results.rig(tmp_path_factory.mktemp("rig")))
    size = result.x.size
    subsets = Compromise(
        "inductance contradicts the other tests",
        ("inductance",),
        result.x[None] - 0.5,
        1e-4 * np.eye(size)[None],
        np.full((1, size), np.nan),
    )
    return replace(
        result,
        influence=Influence(PULLS, {"B_m": "viscous", "J_m": "viscous"}),
        contradictions=(Contradiction("inductance", "L_a", -34.0, 1.2e-3, 0.42e-3, 1e-9, 0.97),),
        compromise=subsets,
    )


def test_the_table_has_the_hardest_pull_of_each_test_and_its_worst_trace(pulled: FitResult) -> None:
    text = render(fit_table(pulled))
    lines = [line.split() for line in text.partition("Influence")[2].splitlines()]
    assert ["inductance", "L_a", "-34.0", "inductance/1.csv", "-20.0"] in lines
    assert ["response", "R_a", "+0.9"] in lines
    assert "Only viscous determines B_m and J_m: no other test checks it." in text


def test_without_influences_there_is_no_table(pulled: FitResult) -> None:
    assert "Influence" not in render(fit_table(replace(pulled, influence=Influence())))


def test_the_parameter_table_shows_a_range_and_the_status(pulled: FitResult) -> None:
    row = next(line for line in render(fit_table(pulled)).splitlines() if line.startswith("R_a"))
    assert "compromise" in row
    assert "..." in row


def test_fit_json_has_the_large_pulls_and_the_contradiction(pulled: FitResult) -> None:
    written = fit_json(pulled)
    assert [each["pull"] for each in written["influence"]] == [-34.0, -20.0, 0.9]  # 0.2 is not worth a line
    assert written["influence"][0] == {"test": "inductance", "file": None, "parameter": "L_a", "pull": -34.0}
    (found,) = written["contradictions"]
    assert (found["test"], found["parameter"], found["value"], found["without"]) == (
        "inductance",
        "L_a",
        1.2e-3,
        4.2e-4,
    )
    assert found["unit"] == "H"
    assert written["only_told_by"] == {"B_m": "viscous", "J_m": "viscous"}
    assert written["compromise"] == "inductance contradicts the other tests"
    r = written["parameters"]["R_a"]
    assert (r["status"], r["stderr"]) == ("compromise", None)
    assert r["ci95"][0] < r["value"] < r["ci95"][1]


def test_the_page_names_the_test_in_its_verdict(pulled: FitResult, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    written = fit_json(pulled)
    runs.changed(run, "fit", **{key: written[key] for key in ("influence", "contradictions", "parameters")})
    page = write_page(run).path.read_text(encoding="utf-8")
    verdict = page.partition('aria-label="Verdict"')[2].partition("</section>")[0]
    assert "inductance contradicts the other tests</strong>: without it" in verdict
    assert "<strong>compromise</strong>: subsets of the data give ranges" in verdict
    assert "Influence: what leaving out a test or a trace would move most" in page
    assert "inductance/1.csv" in page


def test_the_frames_of_the_api(pulled: FitResult) -> None:
    fit = Fit(pulled)
    assert list(fit.influence.columns) == ["test", "file", "parameter", "pull"]
    assert fit.influence.loc[0, "pull"] == -34.0
    assert fit.influence.loc[0, "file"] is None
    assert fit.contradictions.loc["inductance", "without"] == 4.2e-4
    assert fit.parameters.loc["R_a", "status"] == "compromise"
    assert np.isnan(fit.parameters.loc["R_a", "stderr"])
    assert fit.parameters.loc["R_a", "low"] < fit.parameters.loc["R_a", "high"]
    assert "compromise: inductance contradicts the other tests" in repr(fit)


def test_what_is_made_from_a_compromise_says_so(pulled: FitResult) -> None:
    assert "a compromise, not estimates: inductance contradicts" in render(cautioned("table", pulled.state))
    assert render(cautioned("table", replace(pulled, compromise=None).state)).strip() == "table"
