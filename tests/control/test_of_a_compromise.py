"""What is made from a fit that is a compromise: as wide as its ranges, and said so in table, JSON, picture and page."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import results
from etcfit.api.work import design_of
from etcfit.control.design import Design, ecu_of, task_of
from etcfit.control.linearise import reduce
from etcfit.control.request import DesignRequest
from etcfit.estimation.agreement import Compromise
from etcfit.estimation.intervals import Z_95, intervals
from etcfit.estimation.joint_fit import FitResult, quiet
from etcfit.model.ecus import ECUS
from etcfit.reporting.blocks import render
from etcfit.reporting.control import bode
from etcfit.reporting.control.gains import (
    design_parts,
    design_table,
    gains_table,
    loop_table,
    settings_table,
    supply_table,
)
from etcfit.reporting.control.pictures import draw_responses
from etcfit.reporting.control.plant import reduction_table
from etcfit.reporting.control.sentence import cautions, sentence
from etcfit.run_folder.pid import PID
from etcfit.run_folder.plant import reduction_json
from schemas import written_valid

FAR = "the model is far from the data (chi2/dof 17)"
BRIEF = replace(results.BRIEF, draws=40)


def compromised(fit: FitResult, moved: float = 0.2) -> FitResult:
    """One subset that moves every coordinate by so much: ten times what noise alone allows."""
    size = fit.x.size
    points, covariances = fit.x[None] - moved, 1e-4 * np.eye(size)[None]
    subsets = Compromise(FAR, ("inductance",), points, covariances, np.full((1, size), np.nan))
    return replace(fit, chi2_per_dof=17.0, compromise=subsets)


def test_the_model_is_known_as_well_as_its_ranges_say(fit: FitResult) -> None:
    """In coordinates: the far end is 0.2 + 1.96 * 0.01 off, on one side."""
    far = compromised(fit).fitted()
    known = np.isfinite(np.diag(fit.covariance))
    assert np.sqrt(np.diag(far.covariance))[known] == pytest.approx((0.2 + Z_95 * 0.01) / Z_95, rel=1e-9)
    assert np.array_equal(fit.fitted().covariance, fit.covariance)
    stated = intervals(compromised(fit))["K_s"]
    drawn = np.asarray(far.throttles(far.laplace(4000, np.random.default_rng(0))).parameter("K_s"))
    assert stated.low is not None
    assert np.quantile(drawn, 0.025) == pytest.approx(stated.low, rel=0.05)


def test_correlations_are_kept(fit: FitResult) -> None:
    size = fit.x.size
    tied = 0.02**2 * (0.5 * np.eye(size) + 0.5)
    far = compromised(replace(fit, covariance=tied)).fitted().covariance
    sd = np.sqrt(np.diag(far))
    assert np.allclose(far / np.outer(sd, sd), tied / 0.02**2)


@pytest.mark.slow
def test_its_coefficients_have_wider_errors_and_the_table_the_picture_and_the_file_say_why(fit: FitResult) -> None:
    fitted = compromised(fit).fitted()
    known, wide = reduce(fit.fitted()), reduce(fitted)
    assert np.all(wide.stderr > 4.0 * known.stderr)
    shown = " ".join(render(reduction_table(fitted, wide, 0)).split())
    assert FAR in shown
    assert "no standard error" in shown
    assert FAR not in render(reduction_table(fit.fitted(), known, 0))
    made = json.loads(json.dumps(reduction_json(fitted, wide, 0)))
    assert made["fit"] == {"chi2_per_dof": 17.0, "converged": True, "reason": fit.reason, "compromise": FAR}
    drawn = bode.draw(fitted, wide)
    assert FAR in " ".join(" ".join(text.get_text() for text in drawn.texts).split())
    labels = [handle.get_text() for legend in drawn.legends for handle in legend.get_texts()]
    assert "range that subsets of the data give" in labels
    assert "95 % interval" not in labels


@pytest.fixture(scope="module")
def designed(fit: FitResult) -> Design:
    fitted = compromised(fit).fitted()
    made = ECUS["rusefi"]
    ecu = ecu_of(fitted, **made.completed({}))
    return results.proposed(fitted, task_of(fitted, ecu, settings=BRIEF, profile=made), "damping_optimum", "simc")


@pytest.mark.slow
def test_so_do_its_gains(designed: Design, fit: FitResult, tmp_path: Path) -> None:
    made = PID.json(designed)
    found = written_valid(tmp_path, "pid", made)
    assert found["fit"]["compromise"] == FAR
    shown = " ".join(render(design_table(designed)).split())
    assert shown.startswith(f"Caution - The parameters behind this are a compromise, not estimates: {FAR}")
    assert "P(met) are not said of a model that is not the plant" in shown
    drawn = draw_responses(designed)
    assert FAR in " ".join(" ".join(text.get_text() for text in drawn.texts).split())
    assert cautions(found) == compromised(fit).state.cautions
    assert "probability" not in sentence(found)


PASTED = ("<constant", "etb_pFactor", "ticks of 2.00 ms 0", "ticks of 2.00 ms 1", "continuous time")


@pytest.mark.slow
def test_nothing_of_them_is_to_be_pasted_until_it_is_asked_for(designed: Design) -> None:
    shown = render(design_table(designed))
    assert not [each for each in PASTED if each in shown]
    assert "Nothing to paste" in shown
    assert "--anyway" in sentence(PID.json(designed))
    (row,) = (line for line in shown.splitlines() if line.startswith("damping_optimum") and "of a compromise" in line)
    assert row.split()[-2:] == ["-", "-"]
    assert not {"yes", "no"} & {word for line in shown.splitlines() for word in line.split() if line.startswith("simc")}
    found = json.loads(json.dumps(PID.json(designed)))
    assert settings_table(found) is None
    assert supply_table(found) is None
    assert gains_table(found) is None
    assert not [each for part in design_parts(found) for each in PASTED if each in str(part)]
    assert {row["met"] for row in loop_table(found).rows} == {"", "of a compromise"}


@pytest.mark.slow
def test_asked_for_all_the_same_everything_is_given_and_the_caution_still_comes_first(designed: Design) -> None:
    asked = replace(designed, anyway=True)
    shown = render(design_table(asked))
    assert " ".join(shown.split()).startswith("Caution - The parameters behind this are a compromise")
    assert [each for each in ("<constant", "etb_pFactor", "continuous time") if each not in shown] == []
    assert "of a compromise" in shown
    found = json.loads(json.dumps(PID.json(asked)))
    assert found["anyway"] is True
    assert settings_table(found) is not None
    assert sentence(PID.json(asked)) == sentence(found)
    assert "says little of the plant" in sentence(found)


def test_what_is_asked_for_reaches_the_gains_and_the_manifest(monkeypatch: pytest.MonkeyPatch, fit: FitResult) -> None:
    @dataclass(frozen=True)
    class Made:
        anyway: bool = False

    monkeypatch.setattr("etcfit.control.design.design", lambda *args, **options: Made())
    for wanted in (DesignRequest(), DesignRequest(anyway=True)):
        assert design_of(fit.fitted(), wanted, None, quiet).anyway is wanted.anyway
        assert wanted.recorded()["anyway"] is wanted.anyway


@pytest.mark.slow
def test_their_share_of_models_that_meet_all_counts_the_whole_range(designed: Design, fit: FitResult) -> None:
    fitted = fit.fitted()
    narrow = results.proposed(fitted, task_of(fitted, ecu_of(fitted), settings=BRIEF), "damping_optimum")

    def spread(of: Design) -> float:
        band = of.chosen.band
        assert band is not None
        return float(np.mean(band[2] - band[0]))

    assert spread(designed) > 3.0 * spread(narrow)
    assert "compromise" not in render(design_table(narrow))


def test_a_file_of_before_has_no_cautions() -> None:
    assert cautions({}) == ()
    assert cautions({"rule": "optimal"}) == ()
