"""Formula errors: what inexact formulas leave in the residual, and how they move parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import linalg

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.formula_errors import (
    ERROR_STRETCHES,
    EXACT,
    FormulaErrors,
    Stretch,
    chi2_left_by_formula,
    formula_covariance,
    percent_off,
)
from etcfit.diagnosis.score import score
from etcfit.diagnosis.tangents import fitted_samples
from etcfit.estimation.identifiability import WIDE
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS

LIMP, GRAVITY, DRAG = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load", "quadratic_drag"))


@pytest.mark.parametrize(("above", "share"), [(50.0, 0.02), (1.0, 0.0004), (1000.0, 0.04), (-0.1, -0.00004)])
def test_a_formula_leaves_its_error_squared_of_what_it_explained_and_at_most_4_percent(
    above: float, share: float
) -> None:
    assert chi2_left_by_formula(0.02, 500.0 * above, 500.0) == pytest.approx(500.0 * share)


def test_nothing_is_put_down_to_formulas_without_one_or_far_from_the_data(model: CandidateModel) -> None:
    found = model.with_effects((GRAVITY,), {"T_g": 0.2})
    far = replace(found, end=Termination(True, "far", far=True))
    assert FormulaErrors.of_model(model) is EXACT
    assert FormulaErrors.of_model(far) is EXACT
    assert not EXACT
    assert not formula_covariance(far).any()


def test_each_size_of_error_is_named_once() -> None:
    rough = max(EFFECTS, key=lambda e: e.inexact)
    assert rough.inexact > 0.02
    assert percent_off([LIMP.name, DRAG.name]) == "2 %"
    assert percent_off([LIMP.name, rough.name]) == f"2 % and {100 * rough.inexact:.0f} %"


# ---- the covariance of the residual


def errors(columns: np.ndarray, stretches: int) -> FormulaErrors:
    """Of columns over all samples, shape (n, k), in equal stretches."""
    parts = np.array_split(np.arange(len(columns)), stretches)
    return FormulaErrors(tuple(Stretch.of_columns(part, columns[part]) for part in parts), len(columns), ("a", "b"))


def covariance(columns: np.ndarray, stretches: int) -> np.ndarray:
    """M by its definition."""
    out = np.eye(len(columns))
    for part in np.array_split(np.arange(len(columns)), stretches):
        only = np.zeros_like(columns)
        only[part] = columns[part]
        out += only @ only.T
    return out


def test_whitening_is_by_the_root_of_the_covariance_and_chi2_is_generalised_least_squares() -> None:
    rng = np.random.default_rng(0)
    columns, jacobian, r = 5.0 * rng.normal(size=(60, 2)), rng.normal(size=(60, 2)), rng.normal(size=60)
    found, m = errors(columns, 4), covariance(columns, 4)
    root = linalg.inv(linalg.sqrtm(m))
    assert_allclose(found.whitened(r), root @ r, atol=1e-12)
    assert_allclose(found.whitened(jacobian), root @ jacobian, atol=1e-12)
    inverse = linalg.inv(m)
    step = -linalg.solve(jacobian.T @ inverse @ jacobian, jacobian.T @ inverse @ r)
    best = r + jacobian @ step
    assert found.chi2(r, jacobian) == pytest.approx(best @ inverse @ best)


def test_samples_of_some_traces_are_whitened_as_among_all() -> None:
    rng = np.random.default_rng(1)
    columns, r = rng.normal(size=(60, 1)), rng.normal(size=(60, 3))
    found, rows = errors(columns, 4), np.r_[30:45, 0:15]
    only = np.zeros_like(r)
    only[rows] = r[rows]
    assert_allclose(found.whitened(r[rows], rows), found.whitened(only)[rows], atol=1e-14)


def test_what_an_inexact_formula_leaves_is_as_cheap_as_noise_and_anything_else_is_not() -> None:
    """The effect found is 10 % too large in one stretch: 25 standard deviations of noise in all, one by M."""
    t = np.linspace(0.0, 1.0, 400)
    effect = 0.1 * 50.0 * np.sin(40.0 * t)[:, None]
    found, here = errors(effect, 4), np.where(t < 0.25, 1.0, 0.0)
    of_formula, other = effect[:, 0] * here, 5.0 * np.cos(40.0 * t) * here
    nothing = np.zeros((400, 0))
    assert of_formula @ of_formula > 1000.0
    assert found.chi2(of_formula, nothing) == pytest.approx(1.0, rel=0.01)
    assert found.chi2(other, nothing) > 0.98 * other @ other


def test_a_model_s_errors_are_those_of_its_added_effects_stretch_by_stretch(model: CandidateModel) -> None:
    added = model.with_effects((GRAVITY,), {"T_g": 0.2})
    layout = added.problem.layout
    nominal = {p.symbol: p.nominal for p in layout.parameters} | {"T_g": 0.2}
    added = replace(added, x=layout.coordinates(nominal))
    found = FormulaErrors.of_model(added)
    _, jacobian = fitted_samples(added.problem, added.x, added.weighted)
    k = layout.free.index("T_g")
    doubled = jacobian[:, k] * layout.parameter("T_g").domain.coordinate(0.2)
    assert len(found.stretches) == ERROR_STRETCHES * len(added.problem.batch.traces)
    assert_array_equal(np.sort(np.concatenate([s.samples for s in found.stretches])), np.arange(len(doubled)))
    for samples, u, shrinkage in found.stretches:
        size = np.linalg.norm(GRAVITY.inexact * doubled[samples])
        assert_allclose(shrinkage, 1.0 - 1.0 / np.sqrt(1.0 + size**2), atol=1e-9)
        assert_allclose(np.abs(u.T @ doubled[samples]), size / GRAVITY.inexact, rtol=1e-9, atol=1e-12)


def test_held_out_traces_are_allowed_the_same_formula_errors(small: CandidateModel) -> None:
    """The held-out trace is the fitted one: its chi2 is r^T M^-1 r, no parameter refitted."""
    found = small.with_effects((GRAVITY,), {"T_g": 0.2})
    errors = FormulaErrors.of_model(found)
    r, _ = fitted_samples(found.problem, found.x, found.weighted)
    whitened = errors.whitened(r)
    assert score(found, errors).held_out == pytest.approx(whitened @ whitened, rel=1e-12)
    assert whitened @ whitened < r @ r - 1e3
    assert score(found).held_out == pytest.approx(r @ r, rel=1e-9)
    assert FormulaErrors.of_model(replace(found, holdout=None)).held_out is None


# ---- what they do to the parameters


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
