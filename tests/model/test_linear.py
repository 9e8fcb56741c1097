"""The transfer function: closed form against the differentiated model, the paper's numbers, and python-control."""

from __future__ import annotations

import jax
import numpy as np
import pytest

import bodies
import control
from bodies import OPEN, N
from etcfit.model.effects import PAPER, AbstractEffect, Inputs, State
from etcfit.model.effects.electrical import ActuationDelay, BrushVoltageDrop, DriverDeadZone
from etcfit.model.effects.sensors import PositionSensorLag
from etcfit.model.effects.springs import AirflowTorque, LimpHomeSpring
from etcfit.model.linear import PAPER_EQ_8, TransferFunction, closed_form, coefficients, holding_against, sensor_lag
from etcfit.model.paper import TABLE_2
from etcfit.model.parameters import parameters_of
from etcfit.model.throttle import Throttle

LIMP = {"T_lh": 0.6, "K_lh": 0.9, "theta_lh": 0.16, "d_lh": 0.02}
_held = jax.jit(holding_against)
_about = jax.jit(coefficients)
_differentiated = jax.jit(lambda values, theta: coefficients(Throttle.build(PAPER, values), theta, N, 0.0, OPEN))


def drawn(seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {symbol: value * rng.uniform(0.3, 3.0) for symbol, value in bodies.values().items()}


@pytest.mark.parametrize("seed", range(20))
def test_the_differentiated_model_is_the_closed_form(seed: int) -> None:
    values = drawn(seed)
    theta = np.random.default_rng(seed + 99).uniform(0.1, 1.4)
    assert np.allclose(_differentiated(values, theta), closed_form(values, N), rtol=1e-9, atol=0.0)


def test_table_2_gives_what_eqs_1_2_say_and_not_eq_8() -> None:
    one_inertia = {**TABLE_2, "J_m": 0.0}  # with the J_m printed beside it J_eq would be another
    plant = TransferFunction(*map(float, closed_form(one_inertia, N)))
    assert plant.num == pytest.approx((2.208e5,), rel=1e-3)
    assert plant.den == pytest.approx((1.0, 1033.0, 9.370e4, 1.282e5), rel=1e-3)
    assert plant.dc_gain == pytest.approx(1.722, rel=1e-3)
    assert np.allclose(plant.poles, [-1.39, -99.0, -932.5], rtol=0.005)
    assert PAPER_EQ_8.dc_gain == pytest.approx(1.303, rel=1e-3)
    assert np.allclose(sorted(PAPER_EQ_8.poles, key=abs)[:2], [-16.3 - 5.2j, -16.3 + 5.2j], rtol=0.01)


def body(*types: type[AbstractEffect], **values: float) -> Throttle:
    named = {p.symbol: p.nominal for t in types for p in parameters_of(t)} | bodies.values() | values
    return Throttle.build((*PAPER, *types), named)


def test_a_limp_home_spring_stiffens_the_plate_where_it_acts_and_nowhere_else() -> None:
    spring = body(LimpHomeSpring, **LIMP)
    plain = np.asarray(closed_form(bodies.values(), N))
    assert np.allclose(_about(spring, 1.2, N, 0.0, OPEN), plain, rtol=1e-9)
    # below the default angle d torque/d theta = -(T_lh S (1 - S)/d_lh + K_lh S), S the logistic curve
    theta = 0.12
    s = 1.0 / (1.0 + np.exp(-(LIMP["theta_lh"] - theta) / LIMP["d_lh"]))
    more = LIMP["T_lh"] * s * (1.0 - s) / LIMP["d_lh"] + LIMP["K_lh"] * s
    values = bodies.values()
    stiff = closed_form(values | {"K_s": values["K_s"] + more}, N)
    assert np.allclose(_about(spring, theta, N, 0.0, OPEN), stiff, rtol=1e-9)


@pytest.mark.parametrize(
    ("types", "values"),
    [((), {}), ((LimpHomeSpring,), LIMP), ((BrushVoltageDrop, DriverDeadZone), {"V_b": 0.3, "i_b": 0.05, "V_d": 0.2}),
     ((AirflowTorque,), {"T_air": 0.05, "T_air2": -0.01})],
)  # fmt: skip
@pytest.mark.parametrize("theta", [0.05, 0.5, 1.5])
@pytest.mark.parametrize("share", [-1.0, 0.0, 1.0])
def test_the_holding_voltage_holds(types: tuple, values: dict[str, float], theta: float, share: float) -> None:
    throttle = body(*types, **values)
    current, volts = _held(throttle, theta, share, N, 0.0, OPEN)
    c = throttle(State(current, theta, 0.0), throttle.z0, Inputs(volts, 0.0, 0.0, 1.0, 0.0, N, 0.0, OPEN))
    assert abs(float(c.torque + c.drive - share * c.friction)) < 1e-9
    assert abs(float(volts + c.voltage)) < 1e-9


def test_it_follows_the_simulated_body_without_friction() -> None:
    values = bodies.values(T_f=0.0, T_PL=0.0)
    plant = TransferFunction(*map(float, closed_form(values, N)))
    n, dt = 2000, 1e-4
    angle = bodies.path(bodies.body(T_f=0.0, T_PL=0.0), *bodies.batch(np.full(n, dt), 0.5, **bodies.FREE))[:, 1]
    there = control.step_response(plant.to_control(), T=dt * np.arange(n + 1)).outputs
    assert np.max(np.abs(angle - 0.5 * there)) < 1e-4 * np.max(np.abs(angle))


def test_delay_and_lag_stand_beside_it_and_are_appended_when_asked() -> None:
    throttle = body(PositionSensorLag, ActuationDelay, tau_p=4e-3, t_a=2e-3)
    assert float(sensor_lag(throttle)) == 4e-3
    assert float(throttle.delays().input) == 2e-3
    rows = np.asarray(_about(throttle, 0.4, N, 0.0, OPEN))
    assert np.allclose(rows, closed_form(bodies.values(), N), rtol=1e-9)
    plant = TransferFunction(*rows.tolist(), delay=2e-3, lag=4e-3)
    assert len(plant.to_control().den[0][0]) == 4
    s = 2j * np.pi * np.array([1.0, 10.0, 40.0])
    assert np.allclose(plant.to_control(pade_order=3)(s), plant(s), rtol=1e-6)
    assert np.allclose(plant.to_control()(s), plant.bare()(s), rtol=1e-12)
