"""The joint fit on folders from the independent generator: it finds the truth, says how well, and says when not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.estimation import free_run, joint_fit, levenberg_marquardt
from etcfit.estimation.free_run import FreeRun, fitted_free_running
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import Descent, FitResult, deepest, fit, ready, start_values
from etcfit.estimation.levenberg_marquardt import descend, descend_in_stages, fisher_information
from etcfit.estimation.result import Reason
from etcfit.estimation.rounds import after_rounds, after_search
from etcfit.estimation.settings import FitSettings
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.weights import forgiving
from etcfit.rig.base import Fixed, Knowledge, Measurement, Prior, Rig, Start
from etcfit.rig.paper_readings import read_graphs
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, STRENGTHS, Truth, draw_truth, make_folder

SYMBOLS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
SERIES = "series_ohm.inductance"

ROUNDING = 1e-8  # of sums over batches of another length; a held-out trace that was fitted would show above 1e-3


@dataclass(frozen=True)
class Case:
    """A folder, what it was made from, and its fit."""

    truth: Truth
    rig: Rig
    result: FitResult


def folder(path: Path, seed: int) -> tuple[Truth, Rig]:
    truth = draw_truth(np.random.default_rng(seed))
    make_folder(path, truth, seed, size="small")
    return truth, read_folder(path)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """One fit for all tests of this file: compiling the model takes ten times as long as a fit."""
    truth, rig = folder(tmp_path_factory.mktemp("rig"), 4)
    return Case(truth, rig, fit(rig))


def knowing(rig: Rig, **parameters: Knowledge) -> Rig:
    """The same rig with more in its rig.toml."""
    return replace(rig, config=replace(rig.config, parameters={**rig.config.parameters, **parameters}))


def off(truth: Truth, result: FitResult) -> Mapping[str, float]:
    """Errors in stated standard errors."""
    known = intervals(result)
    out = {}
    for symbol in SYMBOLS:
        stderr = known[symbol].stderr
        assert stderr, f"{symbol} has no standard error"
        out[symbol] = (known[symbol].value - getattr(truth, symbol)) / stderr
    return out


# ---- recovery


def test_the_truth_is_found_within_its_stated_errors(case: Case) -> None:
    assert case.result.converged, case.result.reason
    assert case.result.reason_code is Reason.OPTIMUM
    errors = off(case.truth, case.result)
    assert all(abs(error) < 4.0 for error in errors.values()), errors
    assert 0.8 < case.result.chi2_per_dof < 1.25


def test_the_series_resistance_of_a_test_is_found_with_it(case: Case) -> None:
    interval = intervals(case.result)[SERIES]
    assert interval.stderr is not None
    assert abs(interval.value - 1.218) < 4.0 * interval.stderr


def test_the_start_was_far_off(case: Case) -> None:
    """Else finding the truth would prove nothing: the reading misses the data by several standard deviations a sample,
    a scattered start by tens; and the reading's own errors are many times those of the fit."""
    samples = sum(row.n for row in case.result.score_fit)
    reading, *others = case.result.starts
    assert reading.chi2_before > 10.0 * samples
    assert reading.chi2_before > 20.0 * reading.chi2_after
    assert all(start.chi2_before > 10.0 * reading.chi2_before for start in others)
    ratios = [
        abs(case.result.readings.values[s] / getattr(case.truth, s) - 1.0)
        / max(abs(case.result.values[s] / getattr(case.truth, s) - 1.0), 1e-5)
        for s in SYMBOLS
        if s in case.result.readings.values
    ]
    assert np.median(ratios) > 5.0


def test_every_start_descends_and_the_reading_is_the_first(case: Case) -> None:
    assert [start.name for start in case.result.starts] == ["reading", "scattered 1", "scattered 2", "scattered 3"]
    assert all(start.chi2_after < 0.1 * start.chi2_before for start in case.result.starts)
    assert all(start.steps > 0 for start in case.result.starts)


# ---- decisions, as functions of numbers


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_the_deepest_start_is_the_one_gone_on_from(order: tuple[int, ...]) -> None:
    """Three valleys, of depth 900, 20 and 50 a degree of freedom, met in any order."""
    points = [np.array([10.0, 0.0]), np.array([0.0, 10.0]), np.array([5.0, 5.0])]
    ends = [np.array([9.0, 0.0]), np.array([0.0, 9.0]), np.array([4.0, 4.0])]
    depths = (9000.0, 200.0, 500.0)
    near_before = []

    def descend_from(k: int, first: np.ndarray, near: bool) -> Descent:
        assert first is points[order[k]]
        near_before.append(near)
        return Descent(ends[order[k]], 1e6, depths[order[k]], 7 + k)

    found = deepest([points[k] for k in order], descend_from, freedom=10.0)
    assert found.x is ends[1]
    assert found.misfit == 20.0
    assert [(s.name, s.chi2_before, s.steps) for s in found.starts] == [
        ("reading", 1e6, 7), ("scattered 1", 1e6, 8), ("scattered 2", 1e6, 9)
    ]  # fmt: skip
    assert [s.chi2_after for s in found.starts] == [depths[k] for k in order]
    # near the data (chi2 below 30 a degree of freedom) in the second valley: known to the others where it comes first
    assert near_before == [k > 0 and order[0] == 1 for k in range(3)]


@pytest.mark.parametrize(("left", "checks", "made"), [(9.9, 1, 2), (9.9, 0, 1), (9.9, None, 4), (10.1, 1, 4)])
def test_where_the_first_end_leaves_no_more_than_noise_few_other_starts_are_tried(
    left: float, checks: int | None, made: int
) -> None:
    """Chi2 of 10 on 10 degrees of freedom is noise alone."""
    points = [np.zeros(1)] * 4
    found = deepest(points, lambda k, first, near: Descent(first, 1e6, left, 7), freedom=10.0, checks=checks)
    assert len(found.starts) == made


def test_the_guide_is_let_go_until_it_has_led_somewhere(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the valley to which it led it would only lead back there."""
    guided, led = [], iter([False, True, False])

    def recorded(guided_now: bool, problem: Any, x: Any, *_: Any) -> FreeRun:
        guided.append(guided_now)
        return FreeRun(problem, case.result.weighted, x, next(led))

    monkeypatch.setattr(free_run, "freed", lambda *given, guided: recorded(guided, *given))
    monkeypatch.setattr(free_run, "searched", lambda reached, report, settings: reached)
    end = fitted_free_running(case.result.problem, case.result.x, joint_fit.quiet, FitSettings())
    assert guided == [True, True, False]
    assert end.end.far


@pytest.mark.parametrize(("hopeless", "gone"), [(np.inf, 4), (1e300, 4), (0.0, 1)])
def test_the_way_from_a_start_ends_where_even_what_is_forgiven_leaves_too_much(
    hopeless: float, gone: int, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    descents: list[int] = []

    def descended(problem: Any, x: np.ndarray, *given: Any) -> tuple[np.ndarray, int]:
        descents.append(1)
        return x, 5

    monkeypatch.setattr(levenberg_marquardt, "descend", descended)
    result = case.result
    end, steps = descend_in_stages(result.problem, result.x, 1e-2, FitSettings(), hopeless)
    assert len(descents) == gone
    assert steps == 5 * gone
    assert_allclose(end, result.x)


def test_of_equal_ends_the_first_is_gone_on_from_and_one_without_a_value_never_is() -> None:
    ends = [np.array([np.nan]), np.array([1.0]), np.array([2.0])]
    chi2 = [np.inf, 5.0, 5.0]
    found = deepest(ends, lambda k, first, near: Descent(ends[k], np.inf, chi2[k], 0), freedom=1.0)
    assert found.x is ends[1]


def test_the_end_of_the_rounds_is_judged_by_what_the_last_one_moved() -> None:
    judged = {moved: after_rounds(moved, 1e-9) for moved in (0.02, 0.99, 1.01, 9.9, 10.1)}
    assert [end.reason_code for end in judged.values()] == [
        Reason.OPTIMUM, Reason.OPTIMUM, Reason.ALTERNATING, Reason.ALTERNATING, Reason.WANDERING
    ]  # fmt: skip
    assert [end.converged for end in judged.values()] == [True, True, True, True, False]
    assert judged[0.02].reason == (
        "one more step would lower chi2 by 1.0e-09 chi2/dof; "
        "the last round moved no parameter by more than 0.02 standard errors"
    )
    assert "alternate by up to 1 standard errors" in judged[1.01].reason
    assert judged[10.1].reason == "the last round still moved a parameter by 10 standard errors"
    nowhere = after_rounds(0.0, np.nan, outliers=3)
    assert (nowhere.converged, nowhere.reason_code, nowhere.outliers) == (False, Reason.NOT_COMPUTABLE, 3)


def test_the_end_of_a_search_is_judged_by_what_it_still_gained() -> None:
    done, cut = after_search(0.09), after_search(0.11, outliers=2)
    assert (done.converged, done.reason_code) == (True, Reason.SEARCHED)
    assert done.reason.endswith("lowers it by 0.1 chi2/dof")
    assert (cut.converged, cut.reason_code, cut.outliers) == (False, Reason.ROUGH, 2)
    assert "by 0.11 chi2/dof" in cut.reason


def test_everything_is_identifiable_with_all_six_tests_and_responses(case: Case) -> None:
    verdict = case.result.identifiability
    assert verdict.lost == ()
    assert not any(direction.null for direction in verdict.directions)
    assert verdict.symbols == case.result.free_parameters.layout.free


def test_k_m_is_tied_to_k_b_unless_told_otherwise(case: Case) -> None:
    assert case.result.values["K_m"] == case.result.values["K_b"]
    assert intervals(case.result)["K_m"].status == "tied"


def test_residuals_are_standard_normal_trace_by_trace(case: Case) -> None:
    for trace, r in zip(case.result.problem.batch.traces, case.result.whitened, strict=True):
        assert r.shape == trace.data.shape
        assert np.mean(r**2) < 2.0, trace.measurement.file


def test_the_score_is_the_free_run_error_in_logged_units(case: Case) -> None:
    row = next(row for row in case.result.score_fit if row.file == "response/drive_2.csv" and row.channel == "current")
    trace = next(t for t in case.result.problem.batch.traces if t.measurement.file == row.file)
    model = case.result.predicted[row.file][:, trace.channels.index("current")]
    assert row.unit == "mA"
    rms = 1e3 * np.sqrt(np.mean((trace.data[:, trace.channels.index("current")] - model) ** 2))
    assert_allclose(row.rms, rms, rtol=1e-9)
    assert 1.0 <= row.rms / row.sigma < 3.0


@dataclass(frozen=True)
class Again:
    """The same fit once more, what is held out turned into something else, and what it reported on the way."""

    result: FitResult
    said: list[tuple[str, float]]


@pytest.fixture(scope="module")
def again(case: Case) -> Again:
    said: list[tuple[str, float]] = []
    other = replace(case.rig, measurements=tuple(spoilt(m) for m in case.rig.measurements))
    return Again(fit(other, lambda text, share: said.append((text, share))), said)


@pytest.mark.slow
def test_the_same_data_give_the_same_fit_and_progress_is_reported(case: Case, again: Again) -> None:
    # traces held out, which differ here, only make the batch longer: another rounding of its sums
    assert again.result.values == pytest.approx(dict(case.result.values), rel=ROUNDING)
    shares = [share for _, share in again.said]
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0


# ---- what is held out


def spoilt(measurement: Measurement) -> Measurement:
    """Held-out data turned into something else altogether."""
    if not measurement.held_out:
        return measurement
    channels = {name: replace(c, value=c.value[::-1] * 0.7) for name, c in measurement.channels.items()}
    return replace(measurement, channels=channels)


@pytest.mark.slow  # its fit is the one of the test above
def test_what_is_held_out_is_never_fitted(case: Case, again: Again) -> None:
    held = {m.file for m in case.rig.measurements if m.held_out}
    assert held == {"response/drive_3.csv", "static_load/ramp_2.csv"}
    other = again.result
    assert other.values == pytest.approx(dict(case.result.values), rel=ROUNDING)
    assert_allclose(other.covariance, case.result.covariance, rtol=ROUNDING)
    assert {row.file for row in other.score_holdout} == held
    assert {row.file for row in other.score_fit}.isdisjoint(held)
    before = {(row.file, row.channel): row.rms for row in case.result.score_holdout}
    assert all(row.rms > 3.0 * before[row.file, row.channel] for row in other.score_holdout)


def test_what_is_held_out_is_predicted_as_well_as_what_was_fitted(case: Case) -> None:
    assert all(row.rms < 3.0 * row.sigma for row in case.result.score_holdout)


# ---- what is known beforehand


FROM_THE_READING = FitSettings(starts=0)  # the scattered starts end where the reading does


@pytest.mark.slow
def test_a_prior_moves_the_answer_as_the_closed_form_says(case: Case) -> None:
    """x' = x + C_k (m - x_k)/(s^2 + C_kk), for a prior m +- s that disagrees by two standard errors."""
    symbol, layout, x = "K_s", case.result.free_parameters.layout, case.result.x
    k = layout.free.index(symbol)
    jacobian = case.result.problem.linearise(x, case.result.weighted).jacobian
    C = np.linalg.inv(fisher_information(case.result.weighted.prior_sd, jacobian))
    sd = 0.7 * np.sqrt(C[k, k])
    domain = layout.parameter(symbol).domain
    mean = x[k] + 2.0 * np.sqrt(C[k, k])
    width = float(domain.value(mean + 0.5 * sd) - domain.value(mean - 0.5 * sd))
    known = fit(knowing(case.rig, **{symbol: Prior(float(domain.value(mean)), width)}), settings=FROM_THE_READING)
    expected = C[:, k] * (mean - x[k]) / (sd**2 + C[k, k])
    moved = (known.x - x) / np.sqrt(np.diag(C))
    assert_allclose(moved, expected / np.sqrt(np.diag(C)), atol=0.25)
    assert abs(moved[k]) > 1.2


def test_the_start_is_the_reading_else_rig_toml_else_nominal(case: Case) -> None:
    told = free_parameters(knowing(case.rig, K_s=Start(0.9), B_L=Start(3e-3)).config)
    readings = replace(case.result.readings, values={"K_s": 0.11, "R_a": 1.9, "J_eq": 1.0, "L_a": float("nan")})
    start = start_values(told, readings)
    assert (start["K_s"], start["R_a"], start["B_L"]) == (0.11, 1.9, 3e-3)
    assert start["L_a"] == told.layout.parameter("L_a").nominal
    assert "J_eq" not in start


@pytest.mark.slow
def test_what_is_fixed_stays_fixed(case: Case) -> None:
    value = 1.03 * case.truth.K_s
    result = fit(knowing(case.rig, K_s=Fixed(value)))
    assert result.values["K_s"] == value
    assert "K_s" not in result.free_parameters.layout.free
    known = intervals(result)["K_s"]
    assert known.status == "fixed"
    assert known.stderr is None


@pytest.mark.slow
def test_a_free_k_m_loses_the_scale_and_names_it(case: Case) -> None:
    result = fit(knowing(case.rig, K_m=Start(0.0189)))
    assert result.converged, result.reason
    assert set(result.identifiability.lost) >= {"K_m", "J_m", "B_m", "K_s", "T_PL", "T_f"}
    assert set(result.identifiability.lost).isdisjoint({"R_a", "L_a", "K_b"})
    mixed = next(d for d in result.identifiability.directions if d.null and "K_m" in d.symbols)
    assert set(mixed.symbols) >= {"K_m", "J_m", "B_m", "K_s", "T_PL", "T_f"}
    known = intervals(result)
    assert known["K_m"].status == "not identifiable"
    assert known["K_m"].stderr is None
    # the ratio is known as well as before
    assert_allclose(result.values["K_s"] / result.values["K_m"], case.truth.K_s / case.truth.K_m, rtol=0.01)


# ---- failures


def test_a_fit_that_does_not_converge_says_so_and_returns(case: Case) -> None:
    once = FitSettings(starts=0, rounds=1)
    result = fit(case.rig, settings=once)
    assert not result.converged
    assert result.reason_code is Reason.WANDERING
    assert result.settings == once
    assert "still moved" in result.reason
    assert any("NOT CONVERGED" in warning for warning in result.warnings)
    assert np.isfinite(list(result.values.values())).all()


# ---- more folders


@pytest.mark.slow
def test_an_impact_that_a_late_sensor_shows_late_is_no_wall(tmp_path: Path) -> None:
    """A sensor that lags by 4 ms: forgiving a sample only, no start comes near, and J_m vanished."""
    truth = draw_truth(np.random.default_rng(8031), CONSISTENT)
    make_folder(tmp_path, truth, 8031, STRENGTHS["position_sensor_lag"][1], "small")
    rig = read_folder(tmp_path)
    fitted, _, _ = ready(rig)
    known = free_parameters(rig.config)
    start = known.layout.coordinates(start_values(known, read_graphs(rig)))
    problem = EstimationProblem.of_traces(rig.config, known, fitted).refined(start).with_integrator_states(start)
    weighted = problem.weighted(forgiving(problem))
    plain, _ = descend(problem, start, weighted, 1e-2)
    near, _ = descend_in_stages(problem, start, 1e-2)
    before, after = (problem.chi2(x, weighted) / weighted.samples for x in (plain, near))
    assert before > 30.0
    assert after < 3.0
    values = known.layout.values(near, known.held)
    assert all(abs(values[s] / getattr(truth, s) - 1.0) < 0.15 for s in ("K_b", "J_m", "J_L", "K_s", "T_PL", "T_f"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 27])
def test_recovery_over_folders(seed: int, tmp_path: Path) -> None:
    truth, rig = folder(tmp_path, seed)
    result = fit(rig)
    assert result.converged, result.reason
    errors = off(truth, result)
    assert all(abs(error) < 4.0 for error in errors.values()), errors
