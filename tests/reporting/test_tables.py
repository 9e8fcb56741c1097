"""What the commands print besides the views of test_widths.py: what is said of one fit and not of another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import results
import runs
from etcfit.api.fit import Fit
from etcfit.estimation.agreement import Influence
from etcfit.estimation.joint_fit import FitResult
from etcfit.experiment.check import CheckResult
from etcfit.reporting.blocks import cautioned, render
from etcfit.reporting.check_table import check_table
from etcfit.reporting.page import write_page
from etcfit.reporting.tables import fit_table
from etcfit.run_folder.fit import FIT


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m", "J_L"))


def line(text: str, word: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(word))


def test_a_fit_that_did_not_converge_says_why(fitted: FitResult) -> None:
    failed = render(fit_table(replace(fitted, converged=False, reason="the gradient [sic] is not zero")))
    assert "NOT CONVERGED: the gradient [sic] is not zero" in failed


def test_scores_are_pooled_by_test_and_channel(fitted: FitResult) -> None:
    row = next(r for r in fitted.score_fit if r.channel == "current")
    same = (replace(row, n=100, rms=3.0, sigma=1.0), replace(row, n=300, rms=1.0, sigma=1.0, file="b"))
    text = render(fit_table(replace(fitted, score_fit=same, score_holdout=())))
    assert f"{np.sqrt((100 * 9 + 300) / 400):.2f}" in line(text, row.test)
    assert " 400 " in line(text, row.test)


def test_check_table_says_that_nothing_can_be_fitted(fitted: FitResult) -> None:
    text = render(check_table(CheckResult(fitted.rig, (), None, (), None, (), "bench has no trace.")))
    assert "Nothing can be fitted" in text
    assert "bench has no trace." in text


@pytest.fixture(scope="module")
def pulled(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.compromised(results.result(results.rig(tmp_path_factory.mktemp("rig"))))


def test_without_influences_there_is_no_table(pulled: FitResult) -> None:
    assert "Influence" not in render(fit_table(replace(pulled, influence=Influence())))


def test_the_page_names_the_test_in_its_verdict(pulled: FitResult, tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    written = FIT.json(pulled)
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
