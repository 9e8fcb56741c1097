"""Errors of traces and channels together, and how many independent samples a residual is worth."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import folders
import results
from diagnoses import error, score
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import compose
from etcfit.diagnosis.score import (
    Apart,
    chi2_within,
    coordinate_changes,
    distance,
    distance_to,
    folds,
    groups_of,
    holdout_worsened,
    independent,
    left_out,
    only,
    refitted_without,
    tie_covariance,
)
from etcfit.diagnosis.score import score as score_of
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.ready import ready
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.prediction_error import pooled
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig import TESTS
from etcfit.rig.base import Fixed, Rig
from etcfit.rig.reader import read_folder

# ---- errors of traces and channels together


def test_every_sample_counts_alike_in_its_own_noise() -> None:
    """sqrt((30 2^2 + 10 6^2) / 40), whatever the units."""
    assert pooled((error(2.0, 30), error(6.0, 10, sigma=25.0))) == pytest.approx(math.sqrt(12.0))
    assert pooled((error(3.0, 7),)) == pytest.approx(3.0)


def test_a_score_without_held_out_traces_has_no_error_of_theirs() -> None:
    assert score(1.0).holdout_rms is None
    assert score(1.0, held_out=5.0, rms=1.5).holdout_rms == pytest.approx(1.5)
    assert score(1.0, rms=1.5).fit_rms == pytest.approx(1.5)


def test_a_unit_of_chi2_is_worth_the_samples_over_chi2() -> None:
    assert score(500.0, 1000.0).likelihood_per_chi2 == 2.0
    assert math.isfinite(score(0.0).likelihood_per_chi2)


# ---- clearly worse on what was held out


@pytest.mark.parametrize(
    ("rms", "before", "rise", "worse"),
    [
        (1.19, 1.0, 0.2, False),
        (1.21, 1.0, 0.2, True),
        (math.nan, 1.0, 0.2, True),
        (2.9, 1.0, 2.0, False),
        (3.1, 1.0, 2.0, True),
        (None, 1.0, 0.2, False),
        (5.0, None, 0.2, False),
    ],
)
def test_a_refit_that_predicts_the_held_out_traces_clearly_worse_is_refused(
    rms: float | None, before: float | None, rise: float, worse: bool
) -> None:
    assert holdout_worsened(rms, before, rise) is worse


# ---- how many samples there are


def remembering(memory: float, n: int = 4_500) -> np.ndarray:
    """r_k = memory r_(k-1) + w, of variance 1."""
    rng = np.random.default_rng(1)
    w, r = rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        r[k] = memory * r[k - 1] + math.sqrt(1.0 - memory**2) * w[k]
    return r


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
def test_white_samples_are_as_many_as_were_logged_however_large(size: float) -> None:
    assert independent([size * remembering(0.0)]) == pytest.approx(4_500)


def test_samples_that_repeat_one_another_are_fewer() -> None:
    """f = (1 + rho) / (1 - rho) of them go into one, rho = 0.9."""
    assert independent([remembering(0.9)]) == pytest.approx(4_500 / 19.0, rel=0.25)


def test_channels_add_up_and_one_without_a_sample_adds_nothing() -> None:
    one, two = remembering(0.9), remembering(0.5)
    assert independent([one, two, np.empty(0)]) == pytest.approx(independent([one]) + independent([two]))


# ---- a model judged


def test_a_model_is_scored_on_every_sample_that_was_logged_and_on_the_trace_held_out(small: CandidateModel) -> None:
    found = score_of(small)
    logged = sum(int(np.isfinite(t.data).sum()) for t in small.problem.batch.traces)
    assert sum(row.n for row in found.fit_rows) == logged
    assert 0.0 < found.count <= logged
    # weighed by the declared noise alone, chi2 is that of the free run, sample by sample
    assert found.chi2 == pytest.approx(sum(row.n * (row.rms / row.sigma) ** 2 for row in found.fit_rows), rel=1e-6)
    assert found.held_out == pytest.approx(found.chi2)
    assert found.holdout_rms == pytest.approx(found.fit_rms)
    alone = score_of(replace(small, holdout=None))
    assert (alone.held_out, alone.holdout_rms) == (None, None)
    assert alone.chi2 == found.chi2


# ---- Traces left out in turn: each that moves exactly once, none that is held, and only their samples count

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
    problem = EstimationProblem.of_traces(rig.config, known, traces)
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


# ---- What a tie says of two fits, and what it does to the covariance of the parameters

GRAVITY = EFFECT_BY_NAME["gravity_load"]


def test_fits_are_apart_by_the_rms_of_their_difference_over_the_samples() -> None:
    """Entries that hold no sample are 0 and do not count."""
    shape = np.array([1.0, 0.0, -1.0, 0.0]).reshape(4, 1, 1)
    assert distance((4.6 - 3.5) * shape, 4.0) == pytest.approx((4.6 - 3.5) * np.sqrt(0.5))


def test_only_what_both_models_fit_can_have_moved() -> None:
    assert coordinate_changes({"K_s": 1.0, "T_PL": 2.0, "u": 0.5}, {"T_PL": 1.5, "K_s": 3.0, "v": 0.1}) == {
        "K_s": -2.0,
        "T_PL": 0.5,
    }


def test_two_real_fits_are_apart_by_what_the_other_effect_does(small: CandidateModel) -> None:
    other = small.with_effects((GRAVITY,), {"T_g": 0.3})
    other = replace(other, x=other.x + 0.1 * np.array([s == "K_s" for s in other.problem.layout.free]))
    found = distance_to(other, small)
    assert found.moved == {s: pytest.approx(0.1 if s == "K_s" else 0.0) for s in small.problem.layout.free}
    r, still = (s.problem.residual(s.x, s.weighted) for s in (other, small))
    assert found.residual == pytest.approx(np.sqrt(np.sum((r - still) ** 2) / small.weighted.samples))
    assert found.residual > 0.1
    assert distance_to(small, small).residual == 0.0


def test_an_interval_holds_what_the_tied_model_gives() -> None:
    free, tie = ("T_PL", "K_s", "v"), Apart(0.05, {"K_s": -2.0, "T_PL": 0.5})
    added = tie_covariance(free, [tie])
    assert np.allclose(added, np.outer([0.5, -2.0, 0.0], [0.5, -2.0, 0.0]))
    assert np.all(np.abs([0.5, -2.0]) <= 1.96 * np.sqrt(np.diag(added))[:2])
    assert np.array_equal(tie_covariance(free, [tie, tie]), 2.0 * added)
    assert not tie_covariance(free, []).any()
