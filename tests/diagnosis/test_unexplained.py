"""The curve without a name: how well it is known, over which range, and which names it puts in doubt."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from diagnoses import verdict
from etcfit.diagnosis.screen import Background, orthonormal
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.unexplained import (
    best_curve,
    corrects,
    covariance_of,
    curve_sd,
    curves,
    measured_range,
)
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.parameters import parameters_of
from etcfit.model.smooth import UNKNOWNS, K

BY_NAME = {unknown.name: unknown for unknown in UNKNOWNS}
TORQUE, SPEED = BY_NAME["unknown_torque_over_angle"], BY_NAME["unknown_torque_over_speed"]
LIMP, STRIBECK = EFFECT_BY_NAME["limp_home_spring"], EFFECT_BY_NAME["stribeck_friction"]
SETTINGS = DiagnosisSettings()
SCALE = np.array([p.domain.scale for p in parameters_of(TORQUE)])


# ---- how well the curve is known


def linear(seen: int, size: float, entries: int = 4000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A residual of rms `size`, shape (T, L, M), linear in a curve's amplitudes, its Jacobian and information (K, K).

    Only `seen` of the entries hold a sample: integration steps, lanes and slots leave most of them empty.
    """
    rng = np.random.default_rng(0)
    shape = (entries, 1, 1)
    full = np.zeros(shape, dtype=bool)
    full[rng.permutation(entries)[:seen]] = True
    J = np.where(full[..., None], rng.normal(size=(*shape, K)), 0.0)
    r = np.where(full, size * rng.normal(size=shape), 0.0)
    flat = J.reshape(-1, K)
    return r, J, flat.T @ flat


@pytest.mark.parametrize(("size", "unit"), [(0.5, 1.0), (1.0, 1.0), (3.0, 9.0)])
@pytest.mark.parametrize("seen", [1000, 4000])
def test_a_curve_is_known_as_well_as_least_squares_says(seen: int, size: float, unit: float) -> None:
    """sd^2 = s^2 h^T (J^T J)^-1 h, s^2 = chi2 of a sample, at least 1, scale of the amplitudes 0.05 N m: at the knots
    that of the amplitudes, however many entries hold no sample."""
    r, J, information = linear(seen, size)
    sd = curve_sd(TORQUE, np.array(TORQUE.knots), covariance_of(r, J, float(seen)), SCALE)
    expected = 0.05 * np.sqrt(unit * np.diag(np.linalg.inv(information)))
    assert_allclose(sd, expected, rtol=0.06)  # chi2 of 1000 samples is known to 5 %, its root to 2 %


def test_between_knots_both_amplitudes_count() -> None:
    r, J, information = linear(4000, 1.0)
    middle = 0.5 * (TORQUE.knots[3] + TORQUE.knots[4])
    h = np.zeros(K)
    h[3:5] = 0.5
    expected = 0.05 * math.sqrt(h @ np.linalg.solve(information, h))
    assert_allclose(curve_sd(TORQUE, np.array([middle]), covariance_of(r, J, 4000.0), SCALE), expected, rtol=0.05)


def test_an_amplitude_that_the_data_do_not_show_is_left_at_nothing() -> None:
    """Its column is 0: the pseudo-inverse has no variance for it, nor a value that is not finite."""
    r, J, _ = linear(4000, 1.0)
    J[..., 2] = 0.0
    covariance = covariance_of(r, J, 4000.0)
    assert_allclose(covariance[2], np.zeros(K), atol=1e-15)
    assert np.all(np.diag(covariance)[np.arange(K) != 2] > 1e-5)
    assert np.isfinite(covariance).all()


# ---- over which range


def moving(**signals: list[float]) -> dict[str, np.ndarray]:
    """A plate that rests at the first instant."""
    n = len(next(iter(signals.values())))
    return {name: np.array(v) for name, v in signals.items()} | {"torque": np.where(np.arange(n) == 0, np.nan, 0.1)}


def ranged(name: str, *along: dict[str, np.ndarray]) -> tuple[float, float]:
    return measured_range(BY_NAME[name], along, (0.0, 2.0))


def test_a_curve_is_drawn_over_what_was_measured_while_the_plate_moved() -> None:
    two = moving(angle=[0.0, 0.4, 1.2]), moving(angle=[2.0, 1.6, 1.0])
    assert ranged("unknown_torque_over_angle", *two) == pytest.approx((0.2, 0.8))
    speeds = moving(speed=[0.0, -3.0, 2.0])
    assert ranged("unknown_torque_over_speed", speeds) == (-3.0, 2.0)
    assert ranged("unknown_friction_over_speed", speeds) == (2.0, 3.0)


def test_a_voltage_is_drawn_over_the_current_though_no_angle_was_logged() -> None:
    """Without an angle there is no guide, and no torque is read anywhere."""
    blind = {"current": np.array([-1.0, 0.5, 3.0]), "torque": np.full(3, np.nan)}
    assert ranged("unknown_voltage_over_current", blind) == (-1.0, 3.0)


# ---- a name in doubt


# ---- what is tried in its place


def test_only_curves_are_tried() -> None:
    assert curves((LIMP, *UNKNOWNS, STRIBECK)) == list(UNKNOWNS)


def test_the_best_curve_that_helps_elsewhere_is_taken() -> None:
    verdicts = [
        verdict(TORQUE, -40.0),
        verdict(TORQUE, -900.0, holdout_rms_ratio=1.5),
        verdict(SPEED, -50.0),
        verdict(SPEED, -9.0),
    ]
    assert best_curve(verdicts, SETTINGS) == 2


def test_a_curve_that_is_not_worth_its_parameters_is_none() -> None:
    assert best_curve([verdict(TORQUE, -9.0)], SETTINGS) is None
    assert best_curve([], SETTINGS) is None


# ---- one curve against all names together


# ---- a curve that corrects the formula of a named effect

ANGLE = np.linspace(0.0, 1.0, 400)
BOW = ANGLE * (1.0 - ANGLE)  # what an effect does for each unit of its amplitude
HATS = np.stack([np.interp(ANGLE, np.linspace(0.0, 1.0, K), each) for each in np.eye(K)], axis=1)


@pytest.mark.parametrize(
    ("truth", "correction"),
    [
        (np.sin(np.pi * ANGLE), True),  # nearly a bow
        (np.sin(np.pi * ANGLE) + np.sin(2.0 * np.pi * ANGLE), False),  # as much again of another shape
        (np.sin(2.0 * np.pi * ANGLE), False),  # nothing of a bow
    ],
)
def test_a_curve_corrects_a_formula_that_is_nearly_right(truth: np.ndarray, correction: bool) -> None:
    """However effect and curve share the truth between them."""
    of_effect, of_curve = orthonormal(BOW[:, None]), orthonormal(HATS)
    for amplitude in (1.0, 4.0, 8.0):
        c = amplitude * BOW
        h = of_curve @ (of_curve.T @ (truth - c))
        assert corrects(c, h, of_effect, of_curve) == correction


def test_a_curve_over_something_else_corrects_no_formula() -> None:
    """The contribution of the effect is no function of the curve's axis."""
    elsewhere = np.random.default_rng(0).normal(size=ANGLE.size)
    assert not corrects(elsewhere, 0.1 * BOW, orthonormal(elsewhere[:, None]), orthonormal(HATS))


def test_what_other_parameters_could_do_is_taken_off() -> None:
    """Of columns, also of those that are not independent."""
    basis = orthonormal(np.stack([BOW, 2.0 * BOW, ANGLE, np.zeros_like(BOW)], axis=1))
    assert basis.shape == (400, 2)
    assert_allclose(Background.free_of(basis, 3.0 * BOW - ANGLE), 0.0, atol=1e-12)
