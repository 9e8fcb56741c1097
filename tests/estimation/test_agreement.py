"""Do the parts of real fits agree: folders of the independent generator, right ones and ones with a rig's mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import odd_rigs
from etcfit.estimation import contradiction
from etcfit.estimation.agreement import Agreement, agreement
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.result import FitResult
from etcfit.estimation.settings import ContradictionSettings, FitSettings
from etcfit.estimation.statement import pieces_at
from etcfit.rig.reader import read_folder
from etcfit.run_folder import fit_json

pytestmark = pytest.mark.slow  # real fits; what they are judged by has its own tests, on numbers


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return fit(read_folder(odd_rigs.clean(tmp_path_factory.mktemp("rig"), 4)))


def judged_again(result: FitResult, settings: FitSettings) -> Agreement:
    problem, x = result.problem, result.x
    pieces = pieces_at(problem, x, result.weighted)
    return agreement(problem, result.weighted, x, pieces, result.covariance, (False, 1.0), settings)


def test_a_right_folder_has_influences_and_no_contradiction(clean: FitResult) -> None:
    assert clean.contradictions == ()
    assert clean.compromise is None
    assert not any("contradicts" in text for text in clean.warnings)
    assert {i.status for i in intervals(clean).values()} <= {"estimated", "fixed", "tied"}
    assert {"B_m": "viscous"}.items() <= clean.influence.alone.items()
    assert {p.test for p in clean.influence.pulls} == {t.test.name for t in clean.problem.batch.traces}
    assert abs(clean.influence.pulls[0].pull) < 8.0


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


def test_intervals_are_hardly_wider_than_noise_makes_them(clean: FitResult) -> None:
    assert np.median(list(clean.widening.values())) < 1.3


def test_what_is_written_has_the_keys_of_the_contract(clean: FitResult) -> None:
    written = fit_json(clean)
    assert written["influence"]
    assert {"test", "file", "parameter", "pull"} == set(written["influence"][0])
    assert (written["contradictions"], written["compromise"]) == ([], None)


@pytest.mark.parametrize("seed", [7000, 7003])
def test_an_undeclared_resistor_is_found_in_its_test(tmp_path: Path, seed: int) -> None:
    result = fit(read_folder(odd_rigs.undeclared_resistor(tmp_path, seed)))
    assert [each.test for each in result.contradictions] == ["inductance"]
    found = result.contradictions[0]
    assert found.parameter == "L_a"
    true = odd_rigs.truth_of(seed).L_a
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
    truth, layout = odd_rigs.truth_of(seed), result.free_parameters.layout
    for symbol, value in zip(layout.free, layout.numbers(rest)[0], strict=True):
        assert value == pytest.approx(getattr(truth, symbol), rel=0.1), symbol


@pytest.mark.parametrize("seed", [7000, 7001])
def test_a_hot_winding_in_one_test_is_found_there(tmp_path: Path, seed: int) -> None:
    result = fit(read_folder(odd_rigs.hot_winding(tmp_path, seed)))
    (found,) = result.contradictions
    true = odd_rigs.truth_of(seed).R_a
    assert (found.test, found.parameter) == ("resistance", "R_a")
    assert found.without == pytest.approx(true, rel=2e-3)
    assert found.value / true > 1.003
    r = intervals(result)["R_a"]
    assert r.status == "compromise"
    assert r.low is not None
    assert r.high is not None
    assert r.low < true < r.high


def test_a_wrong_angle_scale_leaves_no_estimate(tmp_path: Path) -> None:
    """All tests share it, so that no subset can tell; but nothing is called estimated."""
    result = fit(read_folder(odd_rigs.short_travel(tmp_path, 7000)))
    assert result.compromise is not None
    assert "far from the data" in result.compromise.why
    assert "estimated" not in {i.status for i in intervals(result).values()}
    assert all(i.stderr is None for i in intervals(result).values())
