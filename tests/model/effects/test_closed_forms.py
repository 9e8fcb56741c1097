"""One value of every effect worked out by hand: with the gear fitted, and with the motor alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import pytest
from numpy.testing import assert_allclose

from effect_samples import OPEN, N, inputs, made
from etcfit.model.effects import EFFECT_BY_NAME, Contribution, State

SAME = {"the motor alone": "feels the same"}
TEETH = {"play": 0.02, "tooth_damping": 0.7, "tooth_restitution": 0.3}


class Case(NamedTuple):
    """Parameters, what is expected with the gear fitted and apart (nothing, unless said), and where."""

    parameters: Mapping[str, float]
    fitted: Mapping[str, Any]
    apart: Mapping[str, Any] = {}
    z: tuple[float, ...] = ()
    i: float = 2.0
    u: Mapping[str, float] = {}

    def contribution(self, name: str, plate: float) -> Contribution:
        x = State(self.i, 0.5, -3.0)
        return EFFECT_BY_NAME[name](**self.parameters)(x, self.z, inputs(plate=plate, **self.u))


# at 0.5 rad, -3 rad/s, 2 A and 3 V unless said otherwise
CLOSED: Mapping[str, Case] = {
    # Eqs. 1-2
    "armature": Case(
        {"R_a": 1.5, "L_a": 2e-3, "K_b": 0.02, "K_m": 0.03},
        {"voltage": -1.8 * 2.0 + 0.02 * N * 3.0, "drive": N * 0.03 * 2.0, "inductance": 2e-3},
        SAME,
    ),
    "inertia": Case({"J_m": 1e-6, "J_L": 5e-4}, {"inertia": N**2 * 1e-6 + 5e-4}, {"inertia": N**2 * 1e-6}),
    "viscous_friction": Case(
        {"B_m": 1e-5, "B_L": 2e-3}, {"torque": 3.0 * (N**2 * 1e-5 + 2e-3)}, {"torque": 3.0 * N**2 * 1e-5}
    ),
    "return_spring": Case({"K_s": 0.2, "T_PL": 0.3}, {"torque": -0.4}),
    "coulomb_friction": Case({"T_f": 0.25}, {"friction": 0.25}),
    "end_stops": Case({}, {"lower": 0.0, "upper": OPEN}),
    # electrical
    "brush_voltage_drop": Case({"V_b": 0.4, "i_b": 0.05}, {"voltage": 0.4 * math.tanh(0.6)}, SAME, i=-0.03),
    "winding_heating": Case({"r_h": 0.01, "tau_h": 4.0}, {"voltage": -0.06, "dz": (4.0 - 0.75,)}, SAME, z=(3.0,)),
    "driver_dead_zone": Case({"V_d": 0.3}, {"voltage": 0.3}, SAME, u={"voltage": -5.0}),
    # driven for a quarter of the time, the current dies in 0.6 of that: open for 0.75 - 0.15
    "coasting_bridge": Case({"K_c": 0.3, "k_d": 0.6, "V_0": 12.0}, {"voltage": 0.3 * -3.0 * 0.6 - 0.15 * 12.0}, SAME),
    "actuation_delay": Case({"t_a": 0.004}, {"input_delay": 0.004}, SAME),
    "torque_saturation": Case(
        {"S_T": 0.5}, {"drive": -1.2 * (1.0 - 2.44**-0.5)}, SAME, u={"motor": 1.2, "external": 7.0}
    ),
    # mechanical
    "limp_home_spring": Case(
        {"T_lh": 0.4, "K_lh": 0.8, "theta_lh": 0.55, "d_lh": 0.02},
        {"torque": 0.4 / (1.0 + math.exp(-2.5)) + 0.8 * 0.02 * math.log1p(math.exp(2.5))},
    ),
    "stiffening_spring": Case({"K_3": 0.08}, {"torque": -0.01}),
    "stribeck_friction": Case({"T_s": 0.2, "omega_s": 1.5, "delta_s": 2.0}, {"friction": 0.2 * math.exp(-4.0)}),
    "asymmetric_friction": Case({"T_a": 0.1, "B_a": 0.01}, {"torque": -0.13}),
    "load_dependent_friction": Case({"mu_g": 0.1}, {"friction": 0.08}, u={"motor": -1.0, "external": 0.6}),
    "motor_coulomb_friction": Case({"T_m": 0.004}, {"friction": N * 0.004}, SAME),
    "presliding_friction": Case(
        {"T_z": 0.1, "delta_z": 0.01, "tau_z": 2e-3},
        {"torque": -0.1 * (0.3 - 0.78), "dz": (-390.0,)},
        {"dz": (-390.0,)},
        z=(0.3,),
    ),
    "backlash": Case(
        {"g_b": 0.02, "t_b": 0.01, "c_b": 0.7, "e_b": 0.3},
        {"position": 0.005, "dz": ((math.tanh(0.5) - 0.5) / 0.01,), **TEETH},
        {"dz": (0.0,), **TEETH},
        z=(0.5,),
        u={"motor": 0.05, "external": 0.03},
    ),
    "cogging_torque": Case(
        {"A_c": 0.02, "A_s": 0.03, "n_c": 6.0}, {"torque": -0.02 * math.cos(3.0 * N) - 0.03 * math.sin(3.0 * N)}
    ),
    "quadratic_drag": Case({"D_q": 1e-3}, {"torque": 9e-3}),
    "airflow_torque": Case({"T_air": 0.2, "T_air2": -0.05}, {"torque": -0.2 * math.sin(1.0) + 0.05 * math.sin(2.0)}),
    "stop_bounce": Case({"e_r": 0.4}, {"restitution": 0.4}),
    "gravity_load": Case({"T_g": 0.6}, {"torque": -0.6 * math.sin(0.5)}),
    # sensors; a travel from 0.25 to 1.25 rad puts 0.5 rad at a quarter of it
    "position_sensor_lag": Case({"tau_p": 0.004}, {"position": -0.008, "dz": (-1250.0,)}, {"dz": (-1250.0,)}, z=(2.0,)),
    "position_sensor_nonlinearity": Case(
        {"E_2": 0.02, "E_3": 0.01},
        {"position": 0.015 + 0.01 * 0.5625 * math.sqrt(3.0)},
        u={"lower": 0.25, "upper": 1.25},
    ),
    "current_sensor_offset": Case({"I_0": -0.03}, {"current": -0.03}, SAME),
    "channel_delay": Case({"t_c": 0.001}, {"current_delay": 0.001}, SAME),
}


def compare(found: Contribution, expected: Contribution) -> None:
    """Field by field, all of them."""
    for name in Contribution._fields:
        assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12, atol=0.0, err_msg=name)


def test_every_effect_has_a_closed_form() -> None:
    """By the names of docs/reference/effects.md, which users and other programs write and read."""
    assert set(CLOSED) == set(EFFECT_BY_NAME)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_form_with_the_gear_fitted_and_of_the_motor_alone(name: str) -> None:
    case = CLOSED[name]
    compare(case.contribution(name, plate=1.0), Contribution(**case.fitted))
    expected = case.fitted if case.apart is SAME else case.apart
    compare(case.contribution(name, plate=0.0), Contribution(**expected))


@pytest.mark.parametrize(("symbol", "place"), [("E_2", 0.5), ("E_3", 0.5 - 1.0 / math.sqrt(12.0))])
def test_a_bent_line_is_largest_where_it_should_be(symbol: str, place: float) -> None:
    """Its parameter is its largest value, at the place known from calculus, and the stops read true."""
    effect = made(EFFECT_BY_NAME["position_sensor_nonlinearity"], **({"E_2": 0.0, "E_3": 0.0} | {symbol: 0.02}))
    error = [float(effect(State(0.0, s * OPEN, 0.0), (), inputs()).position) for s in (place, 0.0, 1.0)]
    assert_allclose(error, [0.02, 0.0, 0.0], atol=1e-15)
    around = [float(effect(State(0.0, (place + d) * OPEN, 0.0), (), inputs()).position) for d in (-0.02, 0.02)]
    assert max(around) < 0.02


def test_a_sensor_without_travel_still_reads_a_number() -> None:
    effect = made(EFFECT_BY_NAME["position_sensor_nonlinearity"])
    assert math.isfinite(float(effect(State(0.0, 0.3, 0.0), (), inputs(lower=0.0, upper=0.0)).position))
