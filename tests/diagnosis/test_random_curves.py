"""Random curves in a residual, and how far they may have moved the parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

from etcfit.diagnosis.random_curves import (
    CURVE_LENGTH,
    Curve,
    CurveDiscrepancy,
    curve_discrepancy,
    kernel,
    moved_by_curves,
)
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.smooth import UNKNOWNS

LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))


# ---- Random curves in a residual: found where they are, not where one event is; intervals that hold with and without.

SAMPLES, KNOTS, EVENTS = 1200, 10, 60
TORQUE, FRICTION = (e for e in UNKNOWNS if e.name in ("unknown_torque_over_angle", "unknown_friction_over_speed"))
BELIEVED = np.diag([1e-6, 1e-6])


class Line(NamedTuple):
    """A straight line fitted to samples along an axis that is swept to and fro, and two curves over other axes.

    Args:
        jacobian: of the residual by intercept and slope, shape (SAMPLES, 2).
        curves: over the same axis as the line, and over another one.
    """

    jacobian: np.ndarray
    curves: tuple[Curve, Curve]


def hats(place: np.ndarray) -> np.ndarray:
    """Piecewise linear basis over KNOTS knots, shape (n, KNOTS); place: 0 to KNOTS - 1."""
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(KNOTS)))


@pytest.fixture(scope="module")
def line() -> Line:
    t = np.linspace(0.0, 1.0, SAMPLES)
    axis, other = 0.5 - 0.5 * np.cos(12.0 * t), 0.5 + 0.5 * np.sin(31.0 * t)
    jacobian = 30.0 * np.stack((np.ones(SAMPLES), axis), axis=1)
    own, across = (300.0 * hats((KNOTS - 1) * a) for a in (axis, other))
    return Line(jacobian, (Curve(TORQUE, own), Curve(FRICTION, across)))


EVENT = np.repeat(np.arange(EVENTS), SAMPLES // EVENTS)


def fitted(line: Line, r: np.ndarray) -> tuple[np.ndarray, CurveDiscrepancy]:
    """Least squares where the truth is at 0, and what may have bent it."""
    x = -np.linalg.lstsq(line.jacobian, r, rcond=None)[0]
    return x, curve_discrepancy(r + line.jacobian @ x, line.jacobian, BELIEVED, line.curves, EVENT)


def drawn(rng: np.random.Generator, size: float) -> np.ndarray:
    """Amplitudes over their scale of a random curve of this size."""
    return size * linalg.cholesky(kernel(KNOTS, CURVE_LENGTH), lower=True) @ rng.normal(size=KNOTS)


def held(line: Line, size: float, runs: int) -> tuple[float, float]:
    """Share of 95 % intervals that hold the truth, without and with what is allowed for curves."""
    noise, inside = np.linalg.inv(line.jacobian.T @ line.jacobian), []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        x, found = fitted(line, rng.normal(size=SAMPLES) + line.curves[0].columns @ drawn(rng, size))
        sd = [np.sqrt(np.diag(noise)), np.sqrt(np.diag(noise + found.covariance))]
        inside.append([np.abs(x) < 1.96 * s for s in sd])
    share = np.mean(inside, axis=(0, 2))
    return float(share[0]), float(share[1])


def test_a_curve_that_bent_the_parameters_widens_intervals_until_they_hold(line: Line) -> None:
    without, allowed = held(line, 0.02, 200)
    assert without < 0.1
    assert 0.92 < allowed < 0.98


def test_where_nothing_is_left_intervals_stay_as_they_are(line: Line) -> None:
    sizes = [fitted(line, np.random.default_rng(seed).normal(size=SAMPLES))[1].sizes for seed in range(40)]
    assert not any(sizes)


def test_the_axis_and_the_size_of_a_curve_are_found(line: Line) -> None:
    rng = np.random.default_rng(5)
    found = [fitted(line, rng.normal(size=SAMPLES) + line.curves[1].columns @ drawn(rng, 0.1))[1] for _ in range(20)]
    assert all(each.sizes.get(TORQUE, 0.0) < 0.1 * each.sizes[FRICTION] for each in found)
    scale = line.curves[1].scale
    assert_allclose(np.sqrt(np.mean([each.sizes[FRICTION] ** 2 for each in found])), 0.1 * scale, rtol=0.2)


def test_one_event_is_no_curve(line: Line) -> None:
    r = np.random.default_rng(0).normal(size=SAMPLES)
    burst = np.where(EVENT == 20, 5.0, 0.0)
    assert not fitted(line, r + burst)[1].sizes
    often = np.where(EVENT % 10 == 0, 5.0, 0.0)
    assert fitted(line, r + often)[1].sizes


def test_what_a_curve_moved_is_what_the_joint_estimate_says(line: Line) -> None:
    """Against generalised least squares with the whole covariance of the samples, inverted as it stands."""
    rng = np.random.default_rng(1)
    ways = line.curves[0].columns @ linalg.cholesky(kernel(KNOTS, 3.0), lower=True) * 0.02
    r = rng.normal(size=SAMPLES) + ways @ rng.normal(size=KNOTS)
    j, v = line.jacobian, np.eye(SAMPLES) + ways @ ways.T
    information = j.T @ np.linalg.solve(v, j) + BELIEVED
    by = -np.linalg.solve(information, j.T @ np.linalg.solve(v, r))
    expected = np.linalg.inv(information) - np.linalg.inv(j.T @ j + BELIEVED) + np.outer(by, by)
    assert_allclose(moved_by_curves(r, j, BELIEVED, ways, 1.0), expected, rtol=1e-6)


@pytest.mark.parametrize("curves", [(), (Curve(TORQUE, np.zeros((SAMPLES, KNOTS))),)])
def test_without_curves_that_any_sample_feels_nothing_is_added(line: Line, curves: tuple[Curve, ...]) -> None:
    r = np.random.default_rng(0).normal(size=SAMPLES)
    found = curve_discrepancy(r, line.jacobian, BELIEVED, curves, EVENT)
    assert not found.sizes
    assert not found.covariance.any()


def test_a_parameter_that_no_sample_feels_is_moved_by_none(line: Line) -> None:
    rng = np.random.default_rng(2)
    r = rng.normal(size=SAMPLES) + line.curves[1].columns @ drawn(rng, 0.1)
    jacobian = np.column_stack((line.jacobian, np.zeros(SAMPLES)))
    found = curve_discrepancy(r, jacobian, 1e-6 * np.eye(3), line.curves, EVENT)
    assert found.sizes
    assert_allclose(found.covariance[2, 2], 0.0, atol=1e-6)
    assert np.all(np.diag(found.covariance)[:2] > 0.0)
