"""What a tie says of two fits, and what it does to the covariance of the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.score import Apart, coordinate_changes, distance, distance_to, tie_covariance
from etcfit.model.effects import EFFECT_BY_NAME

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
