"""Answers to steps of a second-order loop, whose overshoot, settling and half-way time are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from etcfit.car_log.log import Series
from etcfit.car_log.steps import log_resolution, noise_sd, steps
from independent.second_order import answer, overshoot, settled
from second_order import log

ZETA_WN = [(0.3, 40.0), (0.456, 30.0), (0.6, 50.0), (0.8, 25.0), (1.5, 60.0)]


@pytest.mark.parametrize(("zeta", "wn"), ZETA_WN)
@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_every_step_has_the_figures_of_the_closed_form(zeta: float, wn: float, rate: float) -> None:
    levels = [20.0, 60.0, 35.0, 40.0, 15.0]
    found = steps(*log(levels, zeta, wn, rate))
    assert [each.before for each in found] == pytest.approx(levels[:-1])
    assert [each.after for each in found] == pytest.approx(levels[1:])
    half = brentq(lambda t: float(answer(np.array([t]), zeta, wn)[0]) - 0.5, 0.0, 1.0)
    for each in found:
        assert each.overshoot == pytest.approx(overshoot(zeta), abs=0.5)
        assert each.settling == pytest.approx(settled(zeta, wn, each.band / abs(each.size)), abs=0.4 / rate + 1e-3)
        assert each.lag == pytest.approx(half, abs=0.2 / rate)
        assert each.error == pytest.approx(0.0, abs=0.01)


def test_what_is_left_at_rest_and_a_plate_that_does_not_settle() -> None:
    position, wanted = log([20.0, 60.0, 30.0], 0.8, 30.0, 200.0)
    first, second = steps(Series(position.time, position.value + 1.5), wanted)
    assert (first.error, second.error) == pytest.approx((1.5, 1.5), abs=0.01)
    assert first.settling == math.inf  # 1.5 % is more than 2 % of 40 %
    assert first.error_pct == pytest.approx(100.0 * 1.5 / 40.0)  # of 40 % of the travel, for both
    assert second.error_pct == pytest.approx(100.0 * 1.5 / 40.0)


def test_noise_makes_no_overshoot_and_does_not_keep_a_plate_from_settling() -> None:
    shown = [s for seed in range(20) for s in steps(*log([20.0, 24.0, 50.0], 1.5, 60.0, 200.0, 0.1, seed))]
    assert sum(each.overshoot > 0.0 for each in shown) <= 2
    assert sum(each.settling < 0.35 for each in shown) >= 38


@pytest.mark.parametrize(("rate", "off"), [(100.0, 6.0), (500.0, 3.0), (1000.0, 3.0)])
def test_noise_makes_the_overshoot_of_a_small_step_no_larger(rate: float, off: float) -> None:
    """Of a step of 2 % under noise of 0.05 %, the highest of many samples would be 6 % of the step too high."""
    shown = [s.overshoot for seed in range(12) for s in steps(*log([20.0, 22.0], 0.559416, 19.2, rate, 0.05, seed))]
    assert len(shown) == 12
    assert np.mean(shown) == pytest.approx(12.0, abs=0.5 * off)
    assert np.max(np.abs(np.array(shown) - 12.0)) < off


def test_a_restless_pedal_makes_a_setpoint_that_rests_all_the_same() -> None:
    position, wanted = log([20.0, 60.0, 35.0, 40.0], 0.6, 40.0, 200.0)
    pedal = wanted.value + 0.1 * np.random.default_rng(0).standard_normal(wanted.time.size)
    found = steps(position, Series(wanted.time, pedal))
    clean = steps(position, wanted)
    assert [s.after for s in found] == pytest.approx([60.0, 35.0, 40.0], abs=0.06)
    assert [s.settling for s in found] == pytest.approx([s.settling for s in clean], abs=0.01)
    assert [s.overshoot for s in found] == pytest.approx([s.overshoot for s in clean], abs=2.0)


def test_a_ramp_is_no_step_and_a_short_rest_none_either() -> None:
    time = np.arange(0.0, 4.0, 0.005)
    ramp = np.interp(time, [0.0, 1.0, 1.5, 4.0], [20.0, 20.0, 60.0, 60.0])
    assert not steps(Series(time, ramp), Series(time, ramp))
    short = np.where((time > 1.0) & (time < 1.2), 60.0, 20.0)
    assert not steps(Series(time, short), Series(time, short))


@pytest.mark.parametrize("sd", [0.02, 0.2])
def test_the_noise_of_a_moving_plate_is_its_sensor_s(sd: float) -> None:
    position, _ = log([20.0, 60.0, 35.0, 40.0], 0.6, 40.0, 500.0, sd)
    assert noise_sd(position.value) == pytest.approx(sd, rel=0.25)


def test_the_resolution_is_read_off_the_values() -> None:
    position, _ = log([20.0, 60.0, 35.0, 40.0], 0.6, 40.0, 500.0, 0.2)
    assert log_resolution(0.4 * np.round(position.value / 0.4)) == pytest.approx(0.4)
    assert log_resolution(position.value) == 0.0
