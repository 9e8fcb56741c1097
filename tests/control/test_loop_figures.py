"""Figures of a response: hand-made ones, and python-control's on a linear case."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import control
from etcfit.control.loop_figures import judge
from etcfit.control.pid import Gains
from etcfit.control.pid.linear_loop import respond
from etcfit.control.setpoint import Level, Setpoint, step, trapezoid
from etcfit.model.ecu import Ecu
from etcfit.model.linear import TransferFunction

UNIT = step(0.0, 1.0, 1.0, lead=0.0)
TIME = UNIT.instants(1e-3)


def test_a_response_made_by_hand() -> None:
    # climbs past 1.1 at 0.2 s, inside 2 % from 0.3 s on, ends 0.4 % low
    share = np.interp(TIME, [0.0, 0.2, 0.2999, 0.3, 1.0], [0.0, 1.1, 1.03, 0.996, 0.996])
    found = judge(UNIT, TIME, share)
    assert found.overshoot_pct == pytest.approx(10.0, abs=0.01)
    assert found.settling_s == pytest.approx(0.3, abs=1.5e-3)
    assert found.steady_state_error_pct == pytest.approx(0.4, abs=1e-9)
    assert found.rmse_pct == pytest.approx(100.0 * np.sqrt(np.mean((share - 1.0) ** 2)))


def test_the_worst_of_both_edges_counts_and_the_lead_does_not() -> None:
    setpoint = trapezoid(lead=0.5)
    time = setpoint.instants(1e-3)
    share = setpoint.at(time)
    share[time < 0.4] = 0.9  # before the first edge nothing is judged
    exact = judge(setpoint, time, share)
    assert (exact.overshoot_pct, exact.steady_state_error_pct, exact.rmse_pct) == pytest.approx(
        (0.0, 0.0, 0.0), abs=1e-9
    )
    closing = share.copy()
    closing[(time > 1.15) & (time < 1.2)] = 0.01  # 4 % of the travel below 5 %: a tenth of the change
    assert judge(setpoint, time, closing).overshoot_pct == pytest.approx(10.0, abs=1e-6)
    assert judge(setpoint, time, closing).settling_s == pytest.approx(0.2, abs=2e-3)


def test_a_hunting_plate_does_not_settle_and_its_error_is_its_swing() -> None:
    share = 1.0 + 0.05 * np.sin(2.0 * np.pi * 7.0 * TIME)
    found = judge(UNIT, TIME, share)
    assert found.settling_s > 0.95
    assert found.steady_state_error_pct == pytest.approx(5.0, abs=0.01)
    stuck = judge(UNIT, TIME, np.full(TIME.size, 0.9))
    assert stuck.settling_s == np.inf
    assert judge(UNIT, TIME, np.full(TIME.size, np.nan)).rmse_pct == np.inf


def test_levels_of_two_ticks_are_judged_too() -> None:
    setpoint = trapezoid()
    time = setpoint.instants(0.25)
    exact = judge(setpoint, time, setpoint.at(time))
    assert exact.overshoot_pct == 0.0
    assert exact.rmse_pct == 0.0
    assert judge(setpoint, time, np.zeros(time.size)).steady_state_error_pct == pytest.approx(112.5)  # 45 % of 40 %


@pytest.mark.parametrize(("damping", "swing"), [(0.2, 60.0), (0.5, 60.0), (0.7, 25.0)])
def test_they_are_python_controls(damping: float, swing: float) -> None:
    plant = control.tf([swing**2], [1.0, 2.0 * damping * swing, swing**2])
    info: Any = control.step_info(plant, T=1e-4 * np.arange(10_000))
    fine = UNIT.instants(1e-4)
    found = judge(UNIT, fine, control.step_response(plant, T=fine).outputs)
    assert found.overshoot_pct == pytest.approx(info["Overshoot"], abs=0.05)
    assert found.settling_s == pytest.approx(info["SettlingTime"], abs=3e-4)


def test_a_loop_that_has_gone_is_not_a_number() -> None:
    plant = TransferFunction(3.10e4, 113.8, 2941.0, 2.38e4)
    y = respond(plant, Gains(80.0, 0.0, 0.0), Ecu(), UNIT)
    assert np.isnan(y[-1])
    assert np.isfinite(y[:5]).all()


def test_a_setpoint_runs_through_its_corners() -> None:
    setpoint = trapezoid(cycles=2)
    assert setpoint.duration == pytest.approx(2.5)
    assert setpoint.at([0.2, 0.55, 0.8, 1.05, 1.3]) == pytest.approx([0.05, 0.25, 0.45, 0.25, 0.05])
    assert setpoint.levels[1] == Level(1.0, 1.5, 0.45, 0.05, "trapezoid")
    assert isinstance(setpoint, Setpoint)
