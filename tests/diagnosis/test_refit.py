"""When a full refit is refused, and what is carried through one."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

import results
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.refit import (
    further_from_data,
    held_out_shows_noise,
    is_no_worse,
    refit_fully,
    refit_worsened,
    settled,
    start,
    whitened,
    with_inertia_shared,
)
from etcfit.diagnosis.score import holdout_rms, score
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached, quiet
from etcfit.estimation.settings import FitSettings
from etcfit.rig.base import Rig

SETTINGS = DiagnosisSettings()
FAR = Termination(True, "far", far=True)


@pytest.mark.parametrize(
    ("after", "before", "further"),
    [
        (1.49, 1.0, False),
        (1.51, 1.0, True),
        (math.nan, 1.0, True),
        (None, 1.0, True),
        (30.0, None, False),
        (None, None, False),
    ],
)
def test_a_refit_that_ends_further_from_the_data_is_spoilt(
    after: float | None, before: float | None, further: bool
) -> None:
    """None is far from the data: there chi2 is by construction 1 a sample, and compares with nothing."""
    assert further_from_data(after, before) is further


def two_points(s: CandidateModel) -> tuple[CandidateModel, CandidateModel]:
    """A model where chi2 is low, and at the end of its own descent, where it is higher: nobody simulated its traces."""
    end = s.optimised()
    return replace(end, x=end.x + 4.0), end


def test_models_are_compared_by_their_chi2_per_sample(small: CandidateModel, monkeypatch: pytest.MonkeyPatch) -> None:
    best, worse = two_points(small)
    ratio = worse.chi2_per_sample / best.chi2_per_sample
    assert ratio > 1.05
    for limit, worsened in ((0.5 + 0.5 * ratio, True), (1.1 * ratio, False)):
        monkeypatch.setattr("etcfit.diagnosis.refit.WORSE_CHI2", limit)
        assert refit_worsened(worse, best) is worsened
    assert refit_worsened(replace(best, end=FAR), best)
    assert not refit_worsened(worse, replace(best, end=FAR))


def test_a_refit_is_judged_without_a_score_of_what_nobody_compares(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    was, module = score(small), importlib.import_module("etcfit.diagnosis.score")
    assert holdout_rms(small) == was.holdout_rms
    assert holdout_rms(replace(small, holdout=None)) is None
    monkeypatch.setattr(module, "independent", lambda *_: pytest.fail("nobody reads it"))
    assert is_no_worse(small, small, was)


def test_a_refit_holds_where_it_is_neither_spoilt_nor_worse_on_what_was_held_out(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The held-out trace is the fitted one here, so its error rises too; the settings say which rise is too much."""
    best, worse = two_points(small)
    was = score(best)
    rise = np.divide(score(worse).holdout_rms or np.nan, was.holdout_rms or np.nan) - 1.0
    assert rise > 0.02
    lenient = replace(SETTINGS, refit_rise=1.1 * rise)
    monkeypatch.setattr("etcfit.diagnosis.refit.WORSE_CHI2", 1e9)
    assert is_no_worse(best, best, was)
    assert is_no_worse(replace(worse, settings=lenient), best, was)
    assert not is_no_worse(replace(worse, settings=replace(lenient, refit_rise=0.9 * rise)), best, was)
    assert is_no_worse(replace(worse, settings=replace(lenient, refit_rise=0.9 * rise), holdout=None), best, was)
    monkeypatch.setattr("etcfit.diagnosis.refit.WORSE_CHI2", 1.0)
    assert not is_no_worse(replace(worse, settings=lenient), best, was)


def test_nothing_contradicts_a_model_to_which_each_held_out_sample_is_noise(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No free run, and no fitted sample by its own whitening. The held-out trace is the fitted one here: the better
    model takes the place of the worse."""
    best, worse = two_points(small)
    was = score(worse)
    assert best.holdout is not None
    for rule in ("refit_worsened", "holdout_worsened"):
        monkeypatch.setattr(f"etcfit.diagnosis.refit.{rule}", lambda *_: True)
    per_sample = best.holdout[0].chi2(best.x, best.holdout[1]) / best.holdout[1].samples
    for limit, noise in ((1.01 * per_sample, True), (0.99 * per_sample, False)):
        monkeypatch.setattr("etcfit.diagnosis.trial.HELD_OUT_NOISE", limit)
        assert held_out_shows_noise(best, worse) is noise
        assert is_no_worse(best, worse, was) is noise
    monkeypatch.setattr("etcfit.diagnosis.trial.HELD_OUT_NOISE", 1e9)
    assert not held_out_shows_noise(worse, best)
    assert not held_out_shows_noise(replace(best, holdout=None), worse)
    assert not held_out_shows_noise(replace(best, end=FAR), worse)


def test_the_last_model_goes_where_a_fit_ends_if_its_data_are_likelier_there(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rounds are left out: these traces are invented, and no model comes near them."""
    own = [whitened(s, s.problem, s.held_out, s.x, s.end) for s in two_points(small)]
    near, far = sorted(own, key=lambda s: s.deviance)
    assert near.deviance < far.deviance - 1.0
    end = Termination(True, "the optimum", gain=0.003)
    reached = Reached(near.problem, near.weighted, near.x, end)
    monkeypatch.setattr("etcfit.diagnosis.refit.fitted_in_rounds", lambda *_: reached)
    new = settled(far, quiet, FitSettings())
    np.testing.assert_array_equal(new.x, near.x)
    assert new.end is end
    assert settled(near, quiet, FitSettings()) is near, "no likelier than where it is"
    elsewhere = replace(far, end=FAR)
    assert settled(elsewhere, quiet, FitSettings()) is elsewhere


@pytest.fixture
def whole(rig: Rig) -> CandidateModel:
    """Of invented traces, with both inertias free."""
    return start(results.result(rig), SETTINGS)


def with_inertias(s: CandidateModel, motor: float, plate: float) -> CandidateModel:
    """The model with N^2 J_m and J_L, kg m2."""
    gear = s.problem.config.gear_ratio
    return replace(s, x=s.problem.layout.coordinates({**s.values, "J_m": motor / gear**2, "J_L": plate}))


@pytest.mark.parametrize(("motor", "vanished"), [(1.5e-5, True), (9.7e-4, False), (9.9e-4, True)])
def test_an_inertia_that_vanished_gets_half_of_the_equivalent_one(
    whole: CandidateModel, small: CandidateModel, motor: float, vanished: bool
) -> None:
    x = with_inertia_shared(with_inertias(whole, motor, 1e-3 - motor))
    if not vanished:
        assert x is None
        return
    assert x is not None
    np.testing.assert_allclose(x, with_inertias(whole, 5e-4, 5e-4).x)
    assert with_inertia_shared(small) is None, "neither is free there"


@pytest.mark.parametrize("likelier", [True, False])
def test_a_refit_with_a_vanished_inertia_ends_where_a_shared_one_leads_if_that_is_likelier(
    whole: CandidateModel, monkeypatch: pytest.MonkeyPatch, likelier: bool
) -> None:
    """The first rounds end without a motor; the second ones stay where they begin."""
    gone = with_inertias(whole, 1e-9, 1e-3)
    shared = with_inertia_shared(gone)
    begun: list[np.ndarray] = []

    def in_rounds(problem: object, x: np.ndarray, *_: object) -> tuple[object, None, np.ndarray, Termination]:
        begun.append(x)
        return problem, None, gone.x if len(begun) == 1 else x, whole.end

    monkeypatch.setattr("etcfit.diagnosis.refit.rounds", in_rounds)
    monkeypatch.setattr("etcfit.diagnosis.refit.whitened", lambda s, *end: replace(s, x=end[2], end=end[3]))
    monkeypatch.setattr("etcfit.diagnosis.refit.MISFIT", 1e99)
    monkeypatch.setattr("etcfit.diagnosis.refit.refit_worsened", lambda *_: False)
    monkeypatch.setattr(CandidateModel, "deviance", property(lambda s: float((s.x is gone.x) is likelier)))
    new = refit_fully(whole, quiet)
    assert shared is not None
    np.testing.assert_array_equal(begun[1], shared)
    np.testing.assert_array_equal(new.x, shared if likelier else gone.x)
