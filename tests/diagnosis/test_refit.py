"""When a full refit is refused, and what is carried through one."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.refit import further_from_data, holds, refit_worsened
from etcfit.diagnosis.score import holdout_rms, score
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.result import Termination

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
    assert further_from_data(after, before, SETTINGS) is further


def moved(s: CandidateModel, by: float) -> CandidateModel:
    """At other coordinates, where chi2 is larger."""
    return replace(s, x=s.x + by)


def test_models_are_compared_by_their_chi2_per_sample(small: CandidateModel) -> None:
    best = small.optimised()
    worse = moved(best, 3.0)
    ratio = worse.chi2_per_sample / best.chi2_per_sample
    assert ratio > 1.05
    strict, lenient = (replace(SETTINGS, worse_chi2=limit) for limit in (0.5 + 0.5 * ratio, 1.1 * ratio))
    assert refit_worsened(replace(worse, settings=strict), best)
    assert not refit_worsened(replace(worse, settings=lenient), best)
    assert refit_worsened(replace(best, end=FAR), best)
    assert not refit_worsened(worse, replace(best, end=FAR))


def test_a_refit_is_judged_without_a_score_of_what_nobody_compares(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    was, module = score(small), importlib.import_module("etcfit.diagnosis.score")
    assert holdout_rms(small) == was.holdout_rms
    assert holdout_rms(replace(small, holdout=None)) is None
    monkeypatch.setattr(module, "independent", lambda *_: pytest.fail("nobody reads it"))
    assert holds(small, small, was)


def test_a_refit_holds_where_it_is_neither_spoilt_nor_worse_on_what_was_held_out(small: CandidateModel) -> None:
    """The held-out trace is the fitted one here, so its error rises too; the settings say which rise is too much."""
    best = small.optimised()
    worse, was = moved(best, 3.0), score(best)
    rise = np.divide(score(worse).holdout_rms or np.nan, was.holdout_rms or np.nan) - 1.0
    assert rise > 0.02
    lenient = replace(SETTINGS, worse_chi2=1e9, refit_rise=1.1 * rise)
    assert holds(best, best, was)
    assert holds(replace(worse, settings=lenient), best, was)
    assert not holds(replace(worse, settings=replace(lenient, worse_chi2=1.0)), best, was)
    assert not holds(replace(worse, settings=replace(lenient, refit_rise=0.9 * rise)), best, was)
    assert holds(replace(worse, settings=replace(lenient, refit_rise=0.9 * rise), holdout=None), best, was)
