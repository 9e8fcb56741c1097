"""Errors of traces and channels together, and how many independent samples a residual is worth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from diagnoses import error, score
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.score import holdout_worsened, independent
from etcfit.diagnosis.score import score as score_of
from etcfit.problem.prediction_error import pooled

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
