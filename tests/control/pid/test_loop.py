"""The simulated loop: python-control where nothing is nonlinear, and each limit of the ECU by itself."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import rigs
from bodies import OPEN
from etcfit.control.loop_figures import REQUIRED, Ran, judge_all
from etcfit.control.pid import Gains
from etcfit.control.pid import loop as loop_module
from etcfit.control.pid.feedforward import bias_of, hold_curve
from etcfit.control.pid.linear_loop import respond
from etcfit.control.setpoint import Stretch, in_turn, step, trapezoid
from etcfit.control.settings import LoopSettings
from etcfit.model.ecu import Ecu
from etcfit.model.effects import State
from etcfit.model.effects.electrical import ActuationDelay
from etcfit.model.effects.sensors import PositionSensorLag
from etcfit.model.pid import Memory, tick

ENDLESS = Ecu(supply=1e9)
SMOOTH = {"T_f": 0.0, "T_PL": 0.0}
GAINS = (40.0, 400.0, 0.3)
RAMP = trapezoid(lead=0.2)


def angle(loop, gains: tuple[float, ...], setpoint=RAMP) -> np.ndarray:
    return np.asarray(loop.respond(rigs.one(*gains), setpoint).position)[0, 0]


@pytest.mark.slow
@pytest.mark.parametrize("period", [5e-4, 1e-3, 4e-3])
def test_without_friction_and_limits_it_is_the_linear_loop(period: float) -> None:
    # begins at angle 0 without a spring torque, so that both begin at rest
    ecu = ENDLESS._replace(period=period, filter=2.0 * period)
    loop = rigs.loop(ecu=ecu, body=rigs.WIDE, **SMOOTH)
    ramp = trapezoid(0.0, 0.4, lead=0.2)
    wide = replace(ramp, shares=tuple(0.5 + 1e-3 * s for s in ramp.shares))  # share 0.5 of the travel is angle 0
    there = respond(rigs.plant(loop), Gains(*GAINS), ecu, wide)
    here = np.asarray(loop.share(angle(loop, GAINS, wide)))
    assert np.ptp(there) > 3e-4
    assert np.max(np.abs(here - there)) < 2e-3 * np.ptp(there)


@pytest.mark.slow
def test_delay_and_lag_of_the_model_are_those_of_the_linear_loop() -> None:
    late = {"t_a": 3e-3, "tau_p": 4e-3}
    loop = rigs.loop(PositionSensorLag, ActuationDelay, ecu=ENDLESS, body=rigs.WIDE,
                     draws={s: [v] for s, v in late.items()}, **SMOOTH)  # fmt: skip
    plants = loop.linear()
    plant = replace(
        rigs.plant(loop), delay=float(np.asarray(plants.delay)[1, 0]), lag=float(np.asarray(plants.lag)[1, 0])
    )
    assert (plant.delay, plant.lag) == pytest.approx((3e-3, 4e-3))
    ramp = trapezoid(0.5, 0.5004, lead=0.2)
    path = np.asarray(loop.share(loop.respond(rigs.one(10.0, 20.0, 0.05), ramp).position))[:, 0]
    there = respond(plant, Gains(10.0, 20.0, 0.05), ENDLESS, ramp)
    # the linear loop's output is the sensor's reading, not the plate
    reading = [path[1, 0]]
    for before, after in pairwise(path[1]):
        reading.append(reading[-1] + (1.0 - np.exp(-1e-3 / 4e-3)) * (0.5 * (before + after) - reading[-1]))
    assert np.max(np.abs(np.array(reading) - there)) < 0.02 * np.ptp(there)
    assert np.max(np.abs(path[0] - path[1])) > 0.02 * np.ptp(there)


@pytest.mark.slow
def test_a_quarter_of_the_integration_step_changes_next_to_nothing() -> None:
    loop = rigs.loop(ecu=Ecu())
    coarse = angle(loop, (120.0, 3000.0, 1.0))
    fine = angle(replace(loop, settings=LoopSettings(longest_step=1.25e-4)), (120.0, 3000.0, 1.0))
    assert np.max(np.abs(coarse - fine)) > 0.0
    assert np.max(np.abs(coarse - fine)) < 2e-3
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 3e-4


def test_draws_and_gains_side_by_side_are_each_what_they_are_alone() -> None:
    both = rigs.loop(ecu=Ecu(), draws={"T_f": [0.1], "K_s": [0.3]})
    gains = Gains(np.array([20.0, 60.0]), np.array([100.0, 500.0]), np.array([0.1, 0.4]))
    path = np.asarray(both.respond(gains, RAMP).position)
    assert path.shape == (2, 2, RAMP.instants(1e-3).size)
    alone = rigs.loop(ecu=Ecu(), T_f=0.1, K_s=0.3)
    assert np.allclose(path[1, 1], angle(alone, (60.0, 500.0, 0.4)), atol=1e-9)
    assert np.max(np.abs(path[0, 1] - path[1, 1])) > 1e-3


@pytest.mark.parametrize(("kernels", "delay"), [(True, 0.0), (True, 2.5e-3), (False, 2.5e-3)])
def test_figures_tick_by_tick_are_those_of_the_whole_response(
    kernels: bool, delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three plants, no whole number of vectors, two stretches, gains that settle and gains that run away."""
    if not kernels:
        monkeypatch.setattr(loop_module, "kernel_of", lambda *of: None)
    loop = rigs.loop(ecu=Ecu(noise=1e-3, delay=delay), draws={"T_f": [0.1, 0.2], "K_s": [0.3, 0.1]})
    gains = Gains(*(np.append(np.geomspace(low, 4.0 * low, 6), 1e9) for low in (20.0, 100.0, 0.1)))
    setpoint = in_turn(trapezoid(), replace(step(0.2, 0.4, hold=0.5), tracked=(Stretch(0.5, 0.7), Stretch(0.8, 0.9))))
    path, tried = loop.respond(gains, setpoint), loop.tried(gains, setpoint)
    np.testing.assert_array_equal(tried.share, loop.share(path.position.copy()))
    ran = Ran(tried.share, path.voltage / loop.ecu.supply, path.current)
    whole = judge_all(setpoint, setpoint.instants(loop.ecu.period), ran).known()
    assert set(whole) < set(tried.figures.known()) == {*REQUIRED}
    for figures in (tried.figures, loop.figures(gains, setpoint)):
        for symbol, figure in whole.items():
            np.testing.assert_allclose(getattr(figures, symbol), figure, rtol=1e-12)
    assert np.unique(tried.figures.rmse_pct[:, :-1]).size == 3 * 6


def test_however_many_models_there_are_one_program_linearises_them_and_each_by_itself() -> None:
    rng, count = np.random.default_rng(0), 19
    loop = rigs.loop(
        ActuationDelay, ecu=Ecu(), draws={"K_s": rng.uniform(0.1, 0.3, count), "t_a": np.full(count, 3e-3)}
    )
    together = loop.linear()
    for k in (0, 7, 8, 15, 16, count):
        alone = loop.taking(np.array([k])).linear()
        for name in ("b0", "a2", "a1", "a0", "delay"):
            assert getattr(together, name)[k] == pytest.approx(getattr(alone, name)[0], rel=1e-14)
    assert together.a0.shape == (count + 1, 1)


def ticked(ecu: Ecu, errors: list[float], gains: tuple[float, ...] = (2.0, 50.0, 0.01)) -> list[float]:
    memory, out = Memory.at_rest(Gains(*gains), ecu, 0.0), []
    for error in errors:
        volts, memory = tick(Gains(*gains), ecu, memory, error, 0.0, 0.0)
        out.append(float(volts))
    return out


def test_one_tick_by_hand() -> None:
    # P 2 e, I 50 T sum e, D 0.01 (e - e_last)/(T_f + T) with the filter's memory
    ecu = Ecu(period=1e-3, filter=1e-3, supply=1e9)
    assert ticked(ecu, [0.1, 0.1]) == pytest.approx([0.2 + 0.005 + 0.01 * 50.0, 0.2 + 0.010 + 0.01 * 25.0])


def test_the_output_is_clamped_and_the_integral_does_not_wind_up() -> None:
    ecu = Ecu(supply=1.0, filter=0.0)
    out = ticked(ecu, [1.0] * 500 + [-1e-3] * 5, (2.0, 50.0, 0.0))
    assert max(out) == 1.0
    # wound up it would hold 500 * 0.05 = 25 V and stay at the limit
    assert abs(out[-1]) < 0.1


def test_pwm_and_sensor_have_steps() -> None:
    assert ticked(Ecu(pwm=0.25, filter=0.0), [0.1], (2.0, 0.0, 0.0)) == [0.25]
    coarse = rigs.loop(ecu=Ecu(resolution=0.05))
    fine = rigs.loop(ecu=Ecu())
    assert np.max(np.abs(angle(coarse, GAINS) - angle(fine, GAINS))) > 5e-3


@pytest.mark.slow
def test_an_ecus_delay_acts_after_as_much_time() -> None:
    jump = step(0.25, 0.35, 0.05, lead=0.3)
    loops = [rigs.loop(ecu=Ecu(delay=d)) for d in (0.0, 2e-3, 2.5e-3)]
    paths = [np.asarray(each.respond(rigs.one(60.0, 300.0, 0.3), jump).current)[0, 0] for each in loops]
    begins = [int(np.argmax(np.abs(np.diff(p[300:])) > 0.2)) for p in paths]
    assert begins[1] - begins[0] == 2
    assert begins[2] - begins[0] in (2, 3)
    assert abs(paths[2][303] - paths[2][300]) < abs(paths[1][303] - paths[1][300])


def test_the_bias_curve_holds_the_plate_within_its_friction() -> None:
    loop = rigs.loop(ecu=Ecu())
    angles = np.linspace(0.1, 1.5, 9)
    down, middle, up = hold_curve(loop.nominal, angles, *loop.body)
    bias = bias_of(loop.nominal, *loop.body)
    volts = np.interp(angles, bias.angles, bias.hold)
    assert np.all((down < volts) & (volts < up))
    # by hand: R (K_s theta + T_PL -+ T_f) / (N K_m)
    per_torque = 1.513 / (20.68 * 0.0189)
    assert np.allclose(middle, per_torque * (0.15 * angles + 0.362), rtol=1e-6)
    assert np.allclose(up - middle, per_torque * 0.239, rtol=1e-6)
    assert bias.opening - bias.hold == pytest.approx(np.full(8, per_torque * 0.239), rel=1e-6)
    assert bias.hold - bias.closing == pytest.approx(np.full(8, per_torque * 0.239), rel=1e-6)


def test_feed_forward_holds_the_plate_against_its_springs_without_an_integral() -> None:
    """Alone P leaves the holding voltage over Kp: per_torque (K_s theta + T_PL) / 40, of a change of 0.4 pi/2 rad."""
    loop = rigs.loop(ecu=Ecu(), T_f=0.0)
    ahead = replace(loop, bias=bias_of(loop.nominal, *loop.body))
    gains = rigs.one(40.0, 0.0, 0.3)
    alone, helped = (float(each.figures(gains, RAMP).steady_state_error_pct[0, 0]) for each in (loop, ahead))
    left = 1.513 / (20.68 * 0.0189) * (0.15 * 0.45 * OPEN + 0.362) / 40.0
    assert alone == pytest.approx(100.0 * left / (0.4 * OPEN), rel=0.1)
    assert helped < 0.02 * alone


def test_a_loop_begins_in_the_state_that_it_is_given() -> None:
    # coasting without spring, friction, stops or voltage: theta = theta_0 + omega_0 tau (1 - exp(-t/tau))
    free = {"K_s": 0.0, "B_m": 0.0, "B_L": 0.01, "K_b": 0.0, "J_m": 0.0, "J_L": 1e-3, **SMOOTH}
    loop = rigs.loop(ecu=Ecu(), body=rigs.WIDE, **free)
    still = Memory(*(np.zeros(()) for _ in Memory._fields))
    path = loop.run(tick, rigs.one(0.0, 0.0, 0.0), still, RAMP, State(0.0, 0.4, 3.0))
    time = RAMP.instants(1e-3)
    assert np.allclose(np.asarray(path.position)[0, 0], 0.4 + 0.3 * (1.0 - np.exp(-time / 0.1)), rtol=0.0, atol=1e-6)
