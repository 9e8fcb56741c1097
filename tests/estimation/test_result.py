"""What a fit leaves behind, on a rig whose optimum, errors and residuals can be written down."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.estimation import goodness
from etcfit.estimation.intervals import intervals
from etcfit.estimation.ready import ready
from etcfit.estimation.result import Budget, FitResult, Optimum, Reason, StartSummary, Termination, outcome
from etcfit.estimation.settings import FitSettings, IdentifiabilitySettings
from etcfit.problem import weights
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Rig
from etcfit.rig.paper_readings import read_graphs
from held_plate import OHM, SIGMA, VOLTS, current, held_plate, problem_of

DONE = Termination(True, "by hand", reason_code=Reason.OPTIMUM)
STARTS = (StartSummary("reading", 1e4, 40.0, 7),)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return held_plate(tmp_path_factory.mktemp("rig"), "1.6")


def left(rig: Rig, end: Termination = DONE, ohm: float = OHM, settings: FitSettings = FitSettings()) -> FitResult:
    """What a fit that ended at a resistance leaves behind."""
    problem = problem_of(rig)
    x = problem.layout.coordinates({"R_a": ohm, "T_f": 0.2})
    weighted = problem.weighted(weights.free_running(problem))
    return outcome(Optimum(rig, read_graphs(rig), problem, (), weighted, x, end, STARTS, ("a note",), settings))


@pytest.fixture(scope="module")
def plain(rig: Rig) -> FitResult:
    return left(rig)


def error(ohm: float = OHM) -> np.ndarray:
    """Measured less simulated current, A; the simulation begins at what was measured."""
    return (current() - VOLTS / ohm)[1:]


def test_what_was_given_is_handed_on(rig: Rig, plain: FitResult) -> None:
    assert (plain.rig, plain.starts) == (rig, STARTS)
    assert (plain.converged, plain.reason, plain.reason_code, plain.far) == (True, "by hand", Reason.OPTIMUM, False)
    assert plain.values["R_a"] == pytest.approx(OHM)
    assert plain.settings == FitSettings()
    assert plain.holdout is None
    assert plain.score_holdout == ()
    fitted = plain.fitted()
    assert_array_equal(fitted.x, plain.x)
    assert fitted.values == plain.values


def test_the_residual_is_the_error_over_its_noise(plain: FitResult) -> None:
    (whitened,) = plain.whitened
    assert_allclose(whitened[1:, 0], error() / SIGMA, atol=1e-6)
    assert plain.chi2_per_dof == pytest.approx(np.sum(whitened**2) / (40 - 2))


def test_the_score_is_the_error_in_the_logged_unit(plain: FitResult) -> None:
    (row,) = plain.score_fit
    assert (row.file, row.channel, row.n) == ("resistance/1.csv", "current", 40)
    predicted = plain.predicted[row.file][:, 0]
    assert_allclose(predicted[1:], VOLTS / OHM, rtol=1e-6)
    assert row.rms == pytest.approx(np.sqrt(np.mean((current() - predicted) ** 2)))
    assert row.sigma == pytest.approx(SIGMA)


def test_what_the_data_do_not_see_is_named(plain: FitResult) -> None:
    assert plain.identifiability.lost == ("T_f",)
    assert intervals(plain)["T_f"].status == "not identifiable"
    known = intervals(plain)["R_a"]
    assert known.stderr == pytest.approx(OHM * SIGMA / (VOLTS / OHM) / np.sqrt(39.0), rel=1e-3)


def test_residuals_larger_than_their_noise_widen_the_intervals_and_are_named(
    rig: Rig, plain: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 2 % off, the mean square of the residual is about 8: sd grows by its root."""
    off = left(rig, ohm=1.02 * OHM)
    size = np.mean(np.append((error(1.02 * OHM) / SIGMA) ** 2, 0.0))
    monkeypatch.setattr(goodness, "LAGS", 5)
    loose = left(rig, ohm=1.02 * OHM)
    assert size > 4.0
    assert off.widening["R_a"] == 1.0  # 40 samples: too few for 12 lags
    assert loose.widening["R_a"] >= np.sqrt(size) * 0.99
    sd = [np.sqrt(result.covariance[0, 0]) for result in (off, loose)]
    assert sd[1] / sd[0] == pytest.approx(loose.widening["R_a"])
    words = [text for text in loose.warnings if "1 of 1 residuals are larger than their noise" in text]
    assert len(words) == 1
    assert f"up to {max(loose.widening.values()):.1f} times" in words[0]
    assert not any("larger than their noise" in text for text in plain.warnings)


def test_rounds_that_alternate_widen_the_interval_by_the_difference_and_say_so(rig: Rig, plain: FitResult) -> None:
    sd = np.sqrt(plain.covariance[0, 0])
    wide = left(rig, replace(DONE, wander=np.array([2.0 * sd, 0.0])))
    assert wide.covariance[0, 0] == pytest.approx(5.0 * sd**2)
    assert wide.covariance[1, 1] == pytest.approx(plain.covariance[1, 1])
    assert any(text.startswith("The rounds of the fit alternate in R_a:") for text in wide.warnings)
    little = left(rig, replace(DONE, wander=np.array([0.4 * sd, 0.0])))
    assert little.covariance[0, 0] == pytest.approx(1.16 * sd**2)
    assert not any("alternate" in text for text in little.warnings)


def test_a_fit_that_did_not_converge_says_so_last(rig: Rig) -> None:
    end = Termination(False, "the reason", outliers=3, reason_code=Reason.ROUGH)
    result = left(rig, end)
    assert (result.converged, result.reason, result.reason_code) == (False, "the reason", Reason.ROUGH)
    assert result.warnings[-1] == "NOT CONVERGED: the reason"
    assert "a note" in result.warnings
    assert any(text.endswith("residuals was reduced: 3 of them.") for text in result.warnings)


def test_a_model_that_is_far_is_judged_free_running(rig: Rig) -> None:
    """Its residual is the free-running error over each sample's own noise, and the words say what the numbers are."""
    far = left(rig, replace(DONE, far=True), ohm=2.0 * OHM)
    assert far.far
    assert_allclose(far.whitened[0][1:, 0], error(2.0 * OHM) / SIGMA, rtol=1e-6)
    assert far.chi2_per_dof > 1e3
    assert any(text.startswith(f"The model is far from the data (chi2/dof {far.chi2_per_dof:.3g})")
               for text in far.warnings)  # fmt: skip


def test_held_out_traces_are_predicted_and_scored_apart(tmp_path: Path) -> None:
    rig = held_plate(tmp_path, "1.6")
    traces = ready(rig).fitted
    problem: Any = problem_of(rig)
    x = problem.layout.coordinates({"R_a": OHM, "T_f": 0.2})
    other = replace(traces[0], measurement=replace(traces[0].measurement, file="resistance/2.csv", held_out=True))
    weighted = problem.weighted(weights.free_running(problem))
    result = outcome(Optimum(rig, read_graphs(rig), problem, (other,), weighted, x, DONE))
    assert isinstance(result.holdout, EstimationProblem)
    assert [row.file for row in result.score_holdout] == ["resistance/2.csv"]
    assert [row.file for row in result.score_fit] == ["resistance/1.csv"]
    assert result.score_holdout[0].rms == pytest.approx(result.score_fit[0].rms)
    assert set(result.predicted) == {"resistance/1.csv", "resistance/2.csv"}


def test_what_counts_as_unknown_is_a_setting(rig: Rig, plain: FitResult) -> None:
    """R_a is known to 0.12 %: with a threshold below that it is lost."""
    strict = FitSettings(identifiability=IdentifiabilitySettings(unknown=1e-3))
    assert left(rig, settings=strict).identifiability.lost == ("R_a", "T_f")
    fine = FitSettings(identifiability=IdentifiabilitySettings(unknown_widened=1e-3))
    assert intervals(replace(plain, settings=fine))["R_a"].status == "not identifiable"
    assert intervals(plain)["R_a"].status == "estimated"


# ---- Which source makes which share of a variance


def test_shares_are_those_of_the_variance_and_sum_to_one() -> None:
    moves = np.array([[3.0, 0.0], [0.0, 0.5]])  # one standard deviation of each source, in coordinates
    found = Budget(("scale of current", "gear ratio"), moves, np.diag([16.0, 0.75])).shares()
    assert_allclose(found, [[9.0 / 25.0, 0.0], [0.0, 0.25], [16.0 / 25.0, 0.75]])
    assert_allclose(found.sum(axis=0), 1.0)


def test_a_parameter_without_any_variance_has_no_shares() -> None:
    assert_allclose(Budget(("gear ratio",), np.zeros((1, 1)), np.zeros((1, 1))).shares(), 0.0)
