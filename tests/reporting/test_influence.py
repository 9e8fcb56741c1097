"""Influence, contradictions and compromises as a person sees them: table, page and caution."""

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
from etcfit.estimation.joint_fit import FitResult
from etcfit.reporting.blocks import cautioned
from etcfit.reporting.page import write_page
from etcfit.reporting.tables import fit_table, render
from etcfit.run_folder.fit import fit_json

PULLS = (
    Pull("inductance", None, "L_a", -34.0, -0.6),
    Pull("inductance", "inductance/1.csv", "L_a", -20.0, -0.4),
    Pull("response", None, "R_a", 0.9, 0.01),
    Pull("response", "response/1.csv", "K_b", 0.2, 0.01),
)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
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


def test_the_table_has_the_hardest_pull_of_each_test_and_its_worst_trace(fitted: FitResult) -> None:
    text = render(fit_table(fitted))
    lines = [line.split() for line in text.partition("Influence")[2].splitlines()]
    assert ["inductance", "L_a", "-34.0", "inductance/1.csv", "-20.0"] in lines
    assert ["response", "R_a", "+0.9"] in lines
    assert "Only viscous determines B_m and J_m: no other test checks it." in text


def test_without_influences_there_is_no_table(fitted: FitResult) -> None:
    assert "Influence" not in render(fit_table(replace(fitted, influence=Influence())))


def test_the_parameter_table_shows_a_range_and_the_status(fitted: FitResult) -> None:
    row = next(line for line in render(fit_table(fitted)).splitlines() if line.startswith("R_a"))
    assert "compromise" in row
    assert "..." in row


def test_fit_json_has_the_large_pulls_and_the_contradiction(fitted: FitResult) -> None:
    written = fit_json(fitted)
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


def test_the_page_names_the_test_in_its_verdict(fitted: FitResult, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    written = fit_json(fitted)
    runs.changed(run, "fit", **{key: written[key] for key in ("influence", "contradictions", "parameters")})
    page = write_page(run).path.read_text(encoding="utf-8")
    verdict = page.partition('aria-label="Verdict"')[2].partition("</section>")[0]
    assert "inductance contradicts the other tests</strong>: without it" in verdict
    assert "<strong>compromise</strong>: subsets of the data give ranges" in verdict
    assert "Influence: what leaving out a test or a trace would move most" in page
    assert "inductance/1.csv" in page


def test_the_frames_of_the_api(fitted: FitResult) -> None:
    fit = Fit(fitted)
    assert list(fit.influence.columns) == ["test", "file", "parameter", "pull"]
    assert fit.influence.loc[0, "pull"] == -34.0
    assert fit.influence.loc[0, "file"] is None
    assert fit.contradictions.loc["inductance", "without"] == 4.2e-4
    assert fit.parameters.loc["R_a", "status"] == "compromise"
    assert np.isnan(fit.parameters.loc["R_a", "stderr"])
    assert fit.parameters.loc["R_a", "low"] < fit.parameters.loc["R_a", "high"]
    assert "compromise: inductance contradicts the other tests" in repr(fit)


def test_what_is_made_from_a_compromise_says_so(fitted: FitResult) -> None:
    assert "a compromise, not estimates: inductance contradicts" in render(cautioned("table", fitted.state))
    assert render(cautioned("table", replace(fitted, compromise=None).state)).strip() == "table"
