"""Contradictions that the widened intervals of a final model hold are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import results
from etcfit.diagnosis.course import covers, reconciled
from etcfit.estimation.agreement import Compromise, in_words
from etcfit.estimation.contradiction import Contradiction
from etcfit.estimation.intervals import intervals
from etcfit.estimation.result import FitResult
from etcfit.rig.base import Rig

TEST = "static_load"


def contradicted(rig: Rig, moved: float) -> FitResult:
    """A fit whose every coordinate, known to 0.02, moves by so much where a test is left out."""
    found = results.result(rig)
    size, covariance = found.x.size, 0.02**2 * np.eye(found.x.size)
    subsets = Compromise(
        f"{TEST} contradicts the other tests",
        ("resistance", TEST),
        np.stack([found.x, found.x + moved]),
        np.stack([covariance, covariance]),
        np.full((2, size), np.nan),
    )
    each = Contradiction(TEST, "K_s", -3.5, found.values["K_s"], 1.01 * found.values["K_s"], 1e-7, 1.0)
    words = in_words(each, "N*m/rad")
    return replace(found, compromise=subsets, contradictions=(each,), warnings=("A word.", words))


@pytest.mark.parametrize(("moved", "held"), [(0.05, True), (-0.05, True), (0.06, False), (np.nan, False)])
def test_intervals_hold_what_lies_within_both_errors(moved: float, held: bool) -> None:
    """1.96 sqrt(2) 0.02 = 0.0554."""
    sd = np.array([0.02, 0.02])
    assert covers(np.array([0.0, moved]), sd, sd) is held


def test_parameters_whose_intervals_hold_what_a_test_pulls_are_estimates(rig: Rig) -> None:
    found = contradicted(rig, 0.05)
    assert intervals(found)["K_s"].status == "compromise"
    after = reconciled(found)
    assert (after.compromise, after.contradictions) == (None, ())
    assert intervals(after)["K_s"].status == "estimated"
    assert after.warnings[0] == "A word."
    (said,) = after.warnings[1:]
    assert said.startswith(f"Without {TEST} K_s would move by 3.5 standard errors of noise alone")


def test_a_contradiction_beyond_the_intervals_stays(rig: Rig) -> None:
    found = contradicted(rig, 0.06)
    assert reconciled(found) is found


def test_a_model_far_from_its_data_stays_a_compromise(rig: Rig) -> None:
    found = replace(contradicted(rig, 0.0), chi2_per_dof=2.5)
    assert reconciled(found) is found
