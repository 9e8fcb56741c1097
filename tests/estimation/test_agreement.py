"""Do the parts of real fits agree: folders of the independent generator, right ones and ones with a rig's mistake."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import linear_parts as parts
import odd_rigs
import results
from etcfit.estimation import contradiction
from etcfit.estimation.agreement import (
    Agreement,
    Compromise,
    Influence,
    Scatter,
    agreement,
    compromise_reason,
    influence,
    scatter,
    widened,
)
from etcfit.estimation.intervals import intervals, lumped
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.estimation.settings import ContradictionSettings, FitSettings
from etcfit.estimation.statement import pieces_at
from etcfit.rig.reader import read_folder
from etcfit.run_folder.fit import FIT


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return fit(read_folder(odd_rigs.clean(tmp_path_factory.mktemp("rig"), 4)))


def judged_again(result: FitResult, settings: FitSettings) -> Agreement:
    problem, x = result.problem, result.x
    pieces = pieces_at(problem, x, result.weighted)
    return agreement(problem, result.weighted, x, pieces, result.covariance, (False, 1.0), settings)


@pytest.mark.slow
def test_a_right_folder_has_influences_and_no_contradiction(clean: FitResult) -> None:
    assert clean.contradictions == ()
    assert clean.compromise is None
    assert not any("contradicts" in text for text in clean.warnings)
    assert {i.status for i in intervals(clean).values()} <= {"estimated", "fixed", "tied"}
    assert {"B_m": "viscous"}.items() <= clean.influence.alone.items()
    assert {p.test for p in clean.influence.pulls} == {t.test.name for t in clean.problem.batch.traces}
    assert abs(clean.influence.pulls[0].pull) < 8.0


@pytest.mark.slow
def test_the_step_without_a_test_is_where_a_refit_without_it_goes(clean: FitResult) -> None:
    """Of every test that moves something: a real refit, with the test's weights 0."""
    layout, tests = clean.free_parameters.layout, contradiction.tests_of(clean.problem)
    seen = 0
    for test in tests:
        rest = tuple(each for each in tests if each != test)
        there = contradiction.fitted_to(clean.problem, clean.weighted, clean.x, rest, clean.settings)
        for pull in clean.influence.pulls:
            if pull.test == test and pull.file is None and abs(pull.pull) > 0.3:
                moved = float((there.x - clean.x)[layout.free.index(pull.parameter)])
                assert moved == pytest.approx(pull.moved, rel=0.3, abs=0.3 * abs(pull.moved / pull.pull))
                seen += 1
    assert seen > 5


@pytest.mark.slow
def test_intervals_are_hardly_wider_than_noise_makes_them(clean: FitResult) -> None:
    assert np.median(list(clean.widening.values())) < 1.3


@pytest.mark.slow
def test_what_is_written_has_the_keys_of_the_contract(clean: FitResult) -> None:
    written = FIT.json(clean)
    assert written["influence"]
    assert {"test", "file", "parameter", "pull"} == set(written["influence"][0])
    assert (written["contradictions"], written["compromise"]) == ([], None)


@pytest.mark.slow
def test_an_undeclared_resistor_is_found_in_its_test(tmp_path: Path) -> None:
    result = fit(read_folder(odd_rigs.undeclared_resistor(tmp_path, 7000)))
    assert [each.test for each in result.contradictions] == ["inductance"]
    found = result.contradictions[0]
    assert found.parameter == "L_a"
    true = odd_rigs.truth_of(7000).L_a
    assert abs(found.value / true - 1.0) > 1.0
    assert found.without == pytest.approx(true, rel=0.02)
    again = judged_again(result, FitSettings(contradiction=ContradictionSettings(moves=1.01 * found.moved)))
    assert (again.contradictions, again.compromise) == ((), None)
    assert [each.test for each in again.outweighed] == ["inductance"]
    assert "inductance disagrees with the other tests" in " ".join(again.words(lambda symbol: "H"))
    assert any(text.startswith("inductance contradicts the other tests: without it L_a is") for text in result.warnings)
    assert "estimated" not in {i.status for i in intervals(result).values()}
    assert result.compromise is not None
    rest = result.compromise.points[result.compromise.without.index("inductance")]
    truth, layout = odd_rigs.truth_of(7000), result.free_parameters.layout
    for symbol, value in zip(layout.free, layout.numbers(rest)[0], strict=True):
        assert value == pytest.approx(getattr(truth, symbol), rel=0.1), symbol


@pytest.mark.slow
def test_a_hot_winding_in_one_test_is_found_there(tmp_path: Path) -> None:
    result = fit(read_folder(odd_rigs.hot_winding(tmp_path, 7000)))
    (found,) = result.contradictions
    true = odd_rigs.truth_of(7000).R_a
    assert (found.test, found.parameter) == ("resistance", "R_a")
    assert found.without == pytest.approx(true, rel=2e-3)
    assert found.value / true > 1.003
    r = intervals(result)["R_a"]
    assert r.status == "compromise"
    assert r.low is not None
    assert r.high is not None
    assert r.low < true < r.high


@pytest.mark.slow
def test_a_wrong_angle_scale_leaves_no_estimate(tmp_path: Path) -> None:
    """All tests share it, so that no subset can tell; but nothing is called estimated."""
    result = fit(read_folder(odd_rigs.short_travel(tmp_path, 7000)))
    assert result.compromise is not None
    assert "far from the data" in result.compromise.why
    assert "estimated" not in {i.status for i in intervals(result).values()}
    assert all(i.stderr is None for i in intervals(result).values())


# ---- Intervals that hold where traces differ by more than their noise, and are left alone where they do not

REACH = np.ones(parts.P)
LEVEL = 0.05


def one(seed: int, differs: float = 0.0, traces: int = 8) -> tuple[Scatter, np.ndarray, np.ndarray]:
    """Scatter, covariance, and the error of the fit to eight traces whose second coordinate differs by so many sd."""
    rng = np.random.default_rng(seed)
    every = parts.jacobians(rng, 40, {"alpha": traces})
    J = np.vstack(list(every.values()))
    covariance = np.linalg.inv(J.T @ J)
    r = parts.residuals(rng, every)
    for key, own in every.items():
        r[key] -= own[:, 1] * differs * np.sqrt(traces * covariance[1, 1]) * rng.standard_normal()
    x = parts.optimum(every, r)
    said = list(parts.said(parts.pieces(every, r, x)).values())
    return scatter(said, parts.nothing_believed(), REACH, 10.0), covariance, x


def test_shifts_are_those_of_the_jackknife() -> None:
    rng = np.random.default_rng(5)
    every = parts.jacobians(rng)
    r = parts.residuals(rng, every)
    x = parts.optimum(every, r)
    found = scatter(list(parts.said(parts.pieces(every, r, x)).values()), parts.nothing_believed(), REACH, 10.0)
    for shift, (test, file) in zip(found.shifts, every, strict=True):
        assert_allclose(shift, parts.optimum(parts.without(every, test, file), r) - x, rtol=1e-6, atol=1e-10)


def test_where_traces_agree_the_test_rejects_as_often_as_it_says() -> None:
    p = np.array([one(seed)[0].p for seed in range(300)])
    assert 0.02 < np.mean(p < LEVEL) < 0.08
    assert stats.kstest(p[:, 0], "uniform").pvalue > 1e-3


def test_where_traces_agree_few_intervals_grow_and_none_shrinks() -> None:
    grown = []
    for seed in range(100):
        found, covariance, _ = one(seed)
        wide = widened(covariance, [found], LEVEL)
        assert np.linalg.eigvalsh(wide - covariance).min() > -1e-12  # nor does that of any combination
        grown.append(np.sqrt(np.diag(wide) / np.diag(covariance)))
    assert np.median(grown) == 1.0
    assert np.mean(grown) < 1.3


def test_where_traces_differ_intervals_hold_that_did_not() -> None:
    inside, before = [], []
    for seed in range(300):
        found, covariance, error = one(seed, differs=4.0)
        wide = widened(covariance, [found], LEVEL)
        inside.append(abs(error[1]) < 1.96 * np.sqrt(wide[1, 1]))
        before.append(abs(error[1]) < 1.96 * np.sqrt(covariance[1, 1]))
    assert np.mean(before) < 0.6
    assert 0.92 < np.mean(inside) <= 0.99


def test_the_covariance_is_that_of_the_formula() -> None:
    found, covariance, _ = one(0, differs=20.0)
    assert found.p[1] < LEVEL
    freedom = 1.0 + found.freedom[1]
    phi = (1.0 + found.freedom[1] * found.ratio[1]) / freedom
    wanted = phi * (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2 * covariance[1, 1]
    assert widened(covariance, [found], LEVEL)[1, 1] == pytest.approx(wanted)


def test_two_clusters_of_which_one_alone_tells_a_coordinate_say_nothing_of_it() -> None:
    rng = np.random.default_rng(2)
    every = parts.jacobians(rng, 40, {"alpha": 1, "beta": 1})
    every["beta", "beta/0.csv"][:, 2] = 0.0
    r = parts.residuals(rng, every, {"alpha": np.array([0.0, 3.0, 3.0])})
    said = list(parts.said(parts.pieces(every, r, parts.optimum(every, r))).values())
    assert reduce(add, said).samples == 80.0
    found = scatter(said, parts.nothing_believed(), REACH, 0.3)
    assert found.ratio[2] == 0.0
    assert found.p[2] == 1.0
    assert found.p[1] < 1e-6


# ---- Leaving a test out, in one step, against the least squares of the others

SYMBOLS = ("a", "b", "c")


def asked(blind: bool = False, reach: float = 1.0) -> tuple[Influence, dict, dict, np.ndarray]:
    """With coordinates so many times as large."""
    rng = np.random.default_rng(3)
    every = {key: J / reach for key, J in parts.jacobians(rng).items()}
    if blind:
        for key, J in every.items():
            if key[0] != "beta":
                J[:, 1] = 0.0
    r = parts.residuals(rng, every)
    x = parts.optimum(every, r)
    traces = parts.said(parts.pieces(every, r, x))
    return influence(SYMBOLS, traces, parts.nothing_believed(), np.full(parts.P, reach), 0.3), every, r, x


def test_every_pull_is_what_a_refit_without_that_part_moves() -> None:
    found, every, r, x = asked()
    assert len(found.pulls) == (3 + 9) * parts.P
    J = np.vstack(list(every.values()))
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    for pull in found.pulls:
        k = SYMBOLS.index(pull.parameter)
        moved = parts.optimum(parts.without(every, pull.test, pull.file), r)[k] - x[k]
        assert pull.moved == pytest.approx(moved, rel=1e-6, abs=1e-10)
        assert pull.pull == pytest.approx(moved / sd[k], rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("reach", [1e-3, 1e3])
def test_what_is_known_does_not_depend_on_the_size_of_a_coordinate(reach: float) -> None:
    for blind in (False, True):
        plain, scaled = asked(blind)[0], asked(blind, reach)[0]
        assert scaled.alone == plain.alone
        assert {(p.test, p.file, p.parameter) for p in scaled.pulls} == {
            (p.test, p.file, p.parameter) for p in plain.pulls
        }
        assert [p.pull for p in scaled.pulls] == pytest.approx([p.pull for p in plain.pulls], rel=1e-5, abs=1e-6)


def test_the_largest_come_first_and_small_ones_are_not_written() -> None:
    found, *_ = asked()
    sizes = [abs(each.pull) for each in found.pulls]
    assert sizes == sorted(sizes, reverse=True)
    kept = found.largest(0.5, 4)
    assert 0 < len(kept) <= 4
    assert all(abs(each.pull) >= 0.5 for each in kept)
    assert found.largest(100.0, 4) == ()


def test_what_one_test_alone_tells_has_no_pull_for_it() -> None:
    found, *_ = asked(blind=True)
    assert found.alone == {"b": "beta"}
    assert not any(each.parameter == "b" and each.test == "beta" and each.file is None for each in found.pulls)
    assert any(each.parameter == "b" and each.file for each in found.pulls)  # two traces of it check each other


# ---- The range that subsets of the data give, and who it concerns


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")))


def subsets(x: np.ndarray, moves: dict[int, float]) -> Compromise:
    """One test left out moves some coordinates, one test alone says the same as all."""
    point = x.copy()
    for k, step in moves.items():
        point[k] += step
    covariance = 0.01**2 * np.eye(x.size)
    return Compromise("why", ("one",), point[None], covariance[None], np.full((1, x.size), np.nan))


def test_a_range_holds_the_interval_stated_and_what_each_subset_says() -> None:
    found = Compromise(
        "why", ("a", "b"), np.array([[1.0, 0.0], [-1.0, 5.0]]),
        np.array([np.diag([0.01, 0.01]), np.diag([0.04, 9.0])]), np.array([[3.0, np.nan]]),
    )  # fmt: skip
    low, high = found.ends(2.0, np.array([-0.5, -0.5]), np.array([0.5, 0.5]), np.array([1.0, 1.0]))
    assert_allclose(low, [-1.0 - 2.0 * 0.2, -0.5])
    assert_allclose(high, [3.0, 0.5])  # of the second, one subset says 0 and the other does not know it


def test_far_from_the_data_nothing_is_estimated(fitted: FitResult) -> None:
    k = fitted.free_parameters.layout.free.index("R_a")
    every = intervals(replace(fitted, compromise=subsets(fitted.x, {k: 0.5})))
    assert {i.status for i in every.values()} == {"compromise", "fixed"}
    was = intervals(fitted)["R_a"]
    assert every["R_a"].stderr is None
    assert every["R_a"].low == pytest.approx(was.low)
    assert every["R_a"].high == pytest.approx(was.value * np.exp(0.5 + 1.96 * 0.01), rel=1e-3)
    assert every["K_m"].status == "compromise"  # tied to K_b
    assert every["K_m"].remark == "K_m = K_b"
    assert {i.status for i in lumped(replace(fitted, compromise=subsets(fitted.x, {}))).values()} == {"compromise"}


def test_a_combination_ranges_over_the_subsets_as_well(fitted: FitResult) -> None:
    k = fitted.free_parameters.layout.free.index("J_L")
    was, now = (lumped(r)["J_eq"] for r in (fitted, replace(fitted, compromise=subsets(fitted.x, {k: 0.7}))))
    assert was.status == "estimated"
    assert now.status == "compromise"
    assert now.stderr is None
    assert now.low is not None
    assert now.high is not None
    assert was.low is not None
    assert was.high is not None
    assert now.low <= was.low < was.high < now.high


def test_what_is_lost_stays_lost(fitted: FitResult) -> None:
    lost = replace(
        fitted, identifiability=replace(fitted.identifiability, lost=("L_a",)), compromise=subsets(fitted.x, {})
    )
    assert intervals(lost)["L_a"].status == "not identifiable"


def test_why_parameters_are_a_compromise() -> None:
    settings = FitSettings()
    assert compromise_reason(False, 1.0, (), settings) is None
    assert "far from the data" in (compromise_reason(True, 1.0, (), settings) or "")
    assert "chi2/dof 30" in (compromise_reason(False, 30.0, ("viscous",), settings) or "")
    assert compromise_reason(False, 1.1, ("viscous",), settings) == "viscous contradicts the other tests"
