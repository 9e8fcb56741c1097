"""Traces left out in turn: each that moves exactly once, none that is held, and only their samples count."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import folders
import results
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import compose
from etcfit.diagnosis.score import chi2_within, folds, groups_of, left_out, only, refitted_without
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.ready import ready
from etcfit.estimation.result import Termination
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig import TESTS
from etcfit.rig.base import Fixed, Rig
from etcfit.rig.reader import read_folder

HELD = {"resistance", "inductance"}


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Five responses and a release, of unlike lengths, among traces of a held plate."""
    files: dict[str, str | bytes] = {**folders.good(), "rig.toml": folders.TOML + results.EXTRA}
    for k in range(2, 6):
        files[f"response/{k}.csv"] = folders.response(40 + 20 * k, seed=k).text()
    files["resistance/2.csv"] = folders.resistance(90, seed=9).text()
    files["rig.toml"] = str(files["rig.toml"]).replace('[holdout]\nfiles = ["response/2.csv"]', "")
    return read_folder(folders.write(tmp_path_factory.mktemp("many"), files))


def candidate(rig: Rig, traces: tuple[Trace, ...]) -> CandidateModel:
    known = free_parameters(rig.config)
    problem = EstimationProblem.of(rig.config, known, traces)
    weighted, layout = problem.weighted(weights.free_running(problem)), known.layout
    x = layout.coordinates({p.symbol: p.nominal for p in layout.parameters})
    composition, end = compose(rig, traces, only=()), Termination(True, "by hand")
    return CandidateModel(composition, (), problem, weighted, None, x, end, DiagnosisSettings())


def entries(s: CandidateModel, k: int) -> np.ndarray:
    """Where the k-th trace lies on the tape, shape (T, L)."""
    lane, row, marks = s.problem.batch.places[k]
    out = np.zeros(s.problem.batch.steps.dt.shape, dtype=bool)
    out[row : marks[-1] + 1, lane] = True
    return out


@pytest.fixture(scope="module")
def s(many: Rig) -> CandidateModel:
    return candidate(many, ready(many)[0])


def test_every_moving_trace_is_left_out_exactly_once_and_a_held_one_never(s: CandidateModel) -> None:
    times = sum(folds(s))
    tests = [t.test.name for t in s.problem.batch.traces]
    assert tests.count("response") == 5
    assert set(tests) > HELD
    expected = np.zeros_like(times)
    for k, test in enumerate(tests):
        expected[entries(s, k)] = test not in HELD
    assert_array_equal(times, expected)


def test_a_trace_is_left_out_as_a_whole(s: CandidateModel) -> None:
    for mask in folds(s):
        assert set(np.unique(mask)) == {0.0, 1.0}
        for k in range(len(s.problem.batch.traces)):
            assert np.unique(mask[entries(s, k)]).size == 1


def test_three_turns_leave_out_two_traces_each(s: CandidateModel) -> None:
    masks = folds(s)
    assert len(masks) == 3
    moving = [k for k, t in enumerate(s.problem.batch.traces) if t.test.name not in HELD]
    for mask in masks:
        assert sum(bool(mask[entries(s, k)].all()) for k in moving) == 2
    assert all(not np.any(a * b) for a, b in combinations(masks, 2))


@pytest.mark.parametrize(("count", "turns"), [(0, 0), (1, 0), (2, 2), (3, 3), (4, 3)])
def test_with_fewer_traces_there_are_fewer_turns_and_with_one_there_is_none(many: Rig, count: int, turns: int) -> None:
    """What is left to fit must move too."""
    every = ready(many)[0]
    moving = [t for t in every if t.test.name not in HELD][:count]
    few = candidate(many, (*moving, *(t for t in every if t.test.name in HELD)))
    assert len(folds(few)) == turns
    if not turns:
        assert left_out(few) == 0.0


def test_samples_outside_the_mask_are_unseen_and_the_others_as_they_were(s: CandidateModel) -> None:
    mask = folds(s)[0]
    some, others = only(s.weighted, mask), only(s.weighted, 1.0 - mask)
    for before, kept, left in (
        (s.weighted.slots.weight, some.slots.weight, others.slots.weight),
        (s.weighted.whitening.weight, some.whitening.weight, others.whitening.weight),
    ):
        assert_array_equal(kept, np.asarray(before) * mask[..., None])
        assert_array_equal(np.asarray(kept) + left, before)
        assert np.any(np.asarray(kept) > 0.0)
        assert np.any(np.asarray(left) > 0.0)
    assert some.steps is s.weighted.steps
    assert some.whitening.gain is s.weighted.whitening.gain


@pytest.fixture(scope="module")
def pair(many: Rig) -> CandidateModel:
    """Two responses; nothing is free but the spring and dry friction."""
    free = {"K_s", "T_f"}
    held = {p.symbol: Fixed(p.nominal) for p in free_parameters(many.config).layout.parameters if p.symbol not in free}
    little = replace(many, config=replace(many.config, parameters=held))
    return candidate(little, tuple(t for t in ready(many)[0] if t.test.name == "response")[:2])


@pytest.mark.slow
def test_a_model_is_refitted_without_what_is_left_out(pair: CandidateModel) -> None:
    """Whatever the trace left out says, the refit does not hear it; and it does hear the other one."""
    first, second = folds(pair)
    spoilt = with_values(pair, 0, 1.5)
    assert_array_equal(refitted_without(spoilt, first), refitted_without(pair, first))
    assert np.max(np.abs(refitted_without(spoilt, second) - refitted_without(pair, second))) > 1e-3
    assert np.max(np.abs(refitted_without(pair, first) - pair.x)) > 1e-3


@pytest.mark.slow
def test_each_model_is_scored_on_what_is_left_out_alone(pair: CandidateModel) -> None:
    first, second = folds(pair)
    x = pair.x
    assert chi2_within(pair, x, first) + chi2_within(pair, x, second) == pytest.approx(pair.chi2)
    assert chi2_within(with_values(pair, 1, 1.5), x, first) == chi2_within(pair, x, first) > 0.0
    each = [chi2_within(pair, refitted_without(pair, mask), mask) for mask in (first, second)]
    assert left_out(pair) == pytest.approx(sum(each))


def with_values(s: CandidateModel, k: int, factor: float) -> CandidateModel:
    """The k-th trace with values so many times as large."""
    lane, row, marks = s.problem.batch.places[k]
    slots = s.weighted.slots
    value = np.array(slots.value)
    value[row : marks[-1] + 1, lane] *= factor
    return replace(s, weighted=s.weighted._replace(slots=slots._replace(value=value)))


def test_traces_are_dealt_out_one_by_one() -> None:
    assert groups_of([3, 5, 8, 9], 3) == [[3, 9], [5], [8]]
    assert groups_of([3, 5], 3) == [[3], [5]]
    assert groups_of([3], 3) == groups_of([], 3) == []


def test_only_traces_of_a_held_plate_are_never_left_out() -> None:
    """A motor that runs alone moves as well."""
    assert {test.name for test in TESTS if test.boundary.plate_held} == {"resistance", "inductance"}
