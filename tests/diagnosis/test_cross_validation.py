"""Traces left out in turn: each that moves exactly once, none that is held, and only their samples count."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import folders
import results
from etcfit.diagnosis import cross_validation as module
from etcfit.diagnosis.cross_validation import folds, left_out
from etcfit.diagnosis.trial import CandidateModel
from etcfit.estimation.joint_fit import ready
from etcfit.estimation.result import Termination
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.problem.weights import free_running
from etcfit.rig.base import Rig
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


def standing(rig: Rig, traces: tuple[Trace, ...]) -> CandidateModel:
    known = free_parameters(rig.config)
    problem = EstimationProblem.of(rig.config, known, traces)
    composition: Any = None
    weighted, x = problem.weighted(free_running(problem)), np.zeros(len(known.layout.free))
    return CandidateModel(composition, (), problem, weighted, None, x, Termination(True, "by hand"))


def entries(s: CandidateModel, k: int) -> np.ndarray:
    """Where the k-th trace lies on the tape, shape (T, L)."""
    lane, row, marks = s.problem.batch.places[k]
    out = np.zeros(s.problem.batch.steps.dt.shape, dtype=bool)
    out[row : marks[-1] + 1, lane] = True
    return out


@pytest.fixture(scope="module")
def s(many: Rig) -> CandidateModel:
    return standing(many, ready(many)[0])


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
    few = standing(many, (*moving, *(t for t in every if t.test.name in HELD)))
    assert len(folds(few)) == turns
    if not turns:
        assert left_out(few) == 0.0


def test_samples_outside_the_mask_are_unseen_and_the_others_as_they_were(s: CandidateModel) -> None:
    mask = folds(s)[0]
    some, others = module._only(s.weighted, mask), module._only(s.weighted, 1.0 - mask)
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


def test_each_model_is_refitted_without_and_scored_on_what_is_left_out(
    s: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model's chi2 of the traces in a mask is made up: their number, times 2 for the one and 3 for the other."""
    refitted = []

    def minimise(problem: Any, x: Any, weighted: Any, tolerance: float) -> tuple[Any, int]:
        refitted.append(np.asarray(weighted.slots.weight) > 0.0)
        return x + 1.0, 1

    def chi2_of(problem: Any, points: Any, weighted: Any) -> np.ndarray:
        seen = np.asarray(weighted.slots.weight) > 0.0
        assert not np.any(seen & refitted[-1])
        return points[:, 0] * seen.sum()

    monkeypatch.setattr(module, "minimise", minimise)
    monkeypatch.setattr(module, "chi2_of", chi2_of)
    before, after = (CandidateModel(**{**vars(s), "x": np.full(s.x.size, level)}) for level in (1.0, 2.0))
    moving = sum(t.data.size for t in s.problem.batch.traces if t.test.name not in HELD)
    assert left_out(before) == 2.0 * moving
    assert left_out(after) == 3.0 * moving
    assert len(refitted) == 6


def test_what_a_plate_does_is_what_its_rig_test_says() -> None:
    """A motor that runs alone moves as well."""
    held: Any = [SimpleNamespace(test=SimpleNamespace(boundary=SimpleNamespace(plate_held=h))) for h in (1, 0, 0)]
    batch = SimpleNamespace(traces=held, places=[(0, 4 * k, 4 * k + np.arange(4)) for k in range(3)],
                           steps=SimpleNamespace(dt=np.zeros((12, 1))))  # fmt: skip
    stub: Any = SimpleNamespace(problem=SimpleNamespace(batch=batch))
    assert_array_equal(np.stack(folds(stub))[..., 0], np.repeat([[0, 1, 0], [0, 0, 1]], 4, axis=1))
