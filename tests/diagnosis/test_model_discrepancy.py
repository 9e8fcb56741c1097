"""What formulas that are not exact may leave, and what they do to parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.model_discrepancy import (
    chi2_left_by_formula,
    formula_covariance,
    formula_error_chi2,
    inexact,
    percent_off,
)
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.identifiability import WIDE
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS

LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))
SETTINGS = DiagnosisSettings()


@pytest.mark.parametrize(("above", "share"), [(50.0, 0.02), (1.0, 0.0004), (1000.0, 0.04), (-0.1, -0.00004)])
def test_a_formula_leaves_its_error_squared_of_what_it_explained_and_at_most_4_percent(
    above: float, share: float
) -> None:
    assert chi2_left_by_formula(0.02, 500.0 * above, 500.0, SETTINGS) == pytest.approx(500.0 * share)


@pytest.mark.parametrize(("before", "share"), [(51.0, 0.02), (2.0, 0.0004), (1001.0, 0.04), (0.9, 0.0)])
def test_effects_found_may_leave_a_share_of_what_the_first_fit_left_above_the_noise(
    model: CandidateModel, before: float, share: float
) -> None:
    found = model.with_effects((GRAVITY,), {"T_g": 0.2})
    assert formula_error_chi2(before, found) == pytest.approx(model.weighted.samples * share)


def test_nothing_is_put_down_to_formulas_without_one_or_far_from_the_data(model: CandidateModel) -> None:
    found = model.with_effects((GRAVITY,), {"T_g": 0.2})
    far = replace(found, end=Termination(True, "far", far=True))
    assert formula_error_chi2(1001.0, model) == 0.0
    assert formula_error_chi2(1001.0, far) == 0.0
    assert not formula_covariance(far).any()


def test_the_least_exact_formula_counts_and_each_size_is_named_once() -> None:
    rough = max(EFFECTS, key=lambda e: e.inexact)
    assert rough.inexact > 0.02
    assert inexact(()) == 0.0
    assert inexact((LIMP, rough, GRAVITY)) == rough.inexact
    assert percent_off([LIMP.name, GRAVITY.name]) == "2 %"
    assert percent_off([LIMP.name, rough.name]) == f"2 % and {100 * rough.inexact:.0f} %"


def test_a_formula_that_is_off_in_one_stretch_of_a_trace_moves_parameters_as_far_as_their_intervals_allow(
    model: CandidateModel,
) -> None:
    """Each stretch in turn is off by as much, and what least squares then make of it is found by least squares."""
    found = model.with_effects((GRAVITY,), {"T_g": 0.2}).lean()
    layout = found.problem.layout
    nominal = {p.symbol: p.nominal for p in layout.parameters} | {"T_g": 0.2}
    found = replace(found, x=layout.coordinates(nominal))
    step = found.x.copy()
    step[layout.free.index("T_g")] = layout.parameter("T_g").domain.coordinate(1.001 * 0.2)
    here = found.problem.linearise(found.x, found.weighted)
    r, jacobian = here.r, here.jacobian
    share = 1000.0 * (found.problem.residual(step, found.weighted) - r)
    held = np.diag(1.0 / (WIDE * layout.reach(found.x)))  # what the data do not tell is kept where it is
    rows = np.vstack((jacobian.reshape(r.size, -1), held))
    expected = np.zeros((found.x.size, found.x.size))
    for lane, _, marks in found.problem.batch.places:
        for stretch in np.array_split(marks, 6):
            off = np.zeros_like(r)
            off[stretch, lane] = GRAVITY.inexact * share[stretch, lane]
            moved = np.linalg.lstsq(rows, np.append(off.ravel(), np.zeros(len(held))), rcond=1e-12)[0]
            expected += np.outer(moved, moved)
    known = [layout.free.index(s) for s in ("R_a", "K_b", "T_f", "T_PL", "T_g")]
    assert_allclose(np.diag(formula_covariance(found))[known], np.diag(expected)[known], rtol=0.02)
    assert np.all(np.diag(expected)[known] > 0.0)
    assert_array_equal(formula_covariance(model), np.zeros((model.x.size, model.x.size)))
