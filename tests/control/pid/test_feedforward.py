"""The bias curve on the corners of a limp-home spring, by the spring's own formula."""

from __future__ import annotations

import numpy as np
import pytest

import rigs
from etcfit.control.pid.feedforward import bias_of, hold_curve, polygon
from etcfit.model.ecu import Ecu
from etcfit.model.effects.limp_home_spring import LimpHomeSpring

LIMP = {"T_lh": 0.69, "K_lh": 0.75, "theta_lh": np.radians(9.0), "d_lh": 0.005}


@pytest.mark.parametrize("width", [0.0005, 0.005, 0.02])
def test_no_point_of_the_travel_is_held_wrong(width: float) -> None:
    """In % of duty at 12 V; points evenly along the curve miss by 1.8 to 3.5 % beside the limp-home position."""
    loop = rigs.loop(LimpHomeSpring, ecu=Ecu(), **{**LIMP, "d_lh": width})
    bias = bias_of(loop.nominal, *loop.body)
    fine = np.linspace(loop.body.lower, loop.body.upper, 50_000)
    down, middle, up = hold_curve(loop.nominal, fine, *loop.body)
    assert np.ptp(middle) > 2.0
    assert 100.0 / 12.0 * np.max(np.abs(bias.volts(fine) - middle)) < 0.4
    assert bias.angles.size == 8
    assert np.all(np.diff(bias.angles) > 0.0)
    # by the springs' own formula, with the corner sharp: far from it the points lie on straight lines
    per_torque = 1.513 / (20.68 * 0.0189)
    assert bias.hold[-1] == pytest.approx(per_torque * (0.15 * np.pi / 2 + 0.362), rel=1e-3)
    assert bias.hold[0] == pytest.approx(per_torque * (0.362 - 0.69 - 0.75 * np.radians(9.0)), rel=1e-3)
    at = np.interp(bias.angles, fine, up), np.interp(bias.angles, fine, down)
    assert np.allclose((bias.opening, bias.closing), at, atol=0.01)


def test_as_few_pieces_as_can_be() -> None:
    """A corner at a third, exactly: two pieces; a parabola x^2 over 0 to 1 missed by 1/(4 n^2) needs n pieces."""
    x = np.linspace(0.0, 1.0, 3001)
    assert polygon(np.maximum(0.0, x - x[1000]), 1e-9) == [0, 1000, 3000]
    for n in (2, 3, 5):
        assert len(polygon(x**2, 1.001 / (4 * n**2))) == n + 1
        assert len(polygon(x**2, 0.99 / (4 * n**2))) == n + 2


def test_a_straight_curve_has_its_points_spread() -> None:
    loop = rigs.loop(ecu=Ecu())
    angles = bias_of(loop.nominal, *loop.body).angles
    assert angles.size == 8
    assert np.max(np.diff(angles)) < 0.3 * np.ptp(angles)
