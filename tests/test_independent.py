"""The generator of synthetic folders against closed forms, conservation of energy, and SciPy with its own events."""

from __future__ import annotations

import ast
import json
import tomllib
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import simpson, solve_ivp

from independent import (
    CATALOGUE,
    CONSISTENT,
    FURTHER,
    MEDIUM,
    NONE,
    OUTSIDE,
    STRENGTHS,
    TABLE_2,
    Bench,
    Effects,
    Truth,
    bench_twin,
    combine,
    draw_truth,
    left_by_itself,
    make_folder,
)
from independent import effects as more
from independent.bridge import duty_of, fed
from independent.drives import Drive, chirp, line, random_steps, steps
from independent.folder import SIZES
from independent.instruments import PERFECT, Sensor, clock, wiper
from independent.kernel import (
    State,
    airflow,
    at_rest,
    bristle_stiffness,
    cogging,
    drag,
    friction_limit,
    motor_friction,
    motor_torque,
    record,
    restoring_torque,
    rippled,
    spring_torque,
    supplied,
    terminal_voltage,
)
from independent.mistakes import Sheet, shifted
from independent.protocols import PROTOCOLS, Series, Session, response
from independent.simulate import NEVER, Motion, motor_alone, resting_angle, simulate, terminals_open, throttle
from independent.truth import OPEN

PACKAGE = Path(__file__).parents[1] / "independent"


def fine(duration: float, step: float = 2e-5) -> np.ndarray:
    return np.linspace(0.0, duration, round(duration / step) + 1)


def silent(duration: float) -> Drive:
    return line([0.0, duration], [0.0, 0.0])


# ---- a second opinion: Eqs. 1-2 by SciPy, one smooth piece after the other


def slope_of(truth: Truth, volts: float, way: int):
    def rates(_, x: np.ndarray) -> list[float]:
        i, w, theta = x
        net = truth.N * truth.K_m * i - truth.B_eq * w - truth.K_s * theta - truth.T_PL - way * truth.T_f
        di = (volts - truth.R_a * i - truth.N * truth.K_b * w) / truth.L_a
        return [di, net / truth.J_eq if way else 0.0, w if way else 0.0]

    return rates


def way_from_rest(truth: Truth, i: float, theta: float, slack: float = 0.0) -> int:
    """1 opens, -1 closes, 0 stays; a torque within `slack` of breakaway has broken away."""
    net = truth.N * truth.K_m * i - truth.K_s * theta - truth.T_PL
    opens, closes = net >= truth.T_f - slack and theta < OPEN, net <= slack - truth.T_f and theta > 0.0
    return int(opens) - int(closes)


def ends_of(truth: Truth, way: int):
    """What may end a smooth piece: breakaway either way if stuck; else speed through zero, or a stop."""
    if way == 0:
        events = [
            lambda _, x: truth.N * truth.K_m * x[0] - truth.K_s * x[2] - truth.T_PL - truth.T_f if x[2] < OPEN else -1,
            lambda _, x: truth.T_PL + truth.K_s * x[2] - truth.N * truth.K_m * x[0] - truth.T_f if x[2] > 0 else -1,
        ]
        directions = [1, 1]
    else:
        events = [lambda _, x: x[1], lambda _, x: x[2] - (OPEN if way > 0 else 0.0)]
        directions = [-way, way]
    for event, direction in zip(events, directions, strict=True):
        event.terminal, event.direction = True, direction
    return events


def reference(truth: Truth, durations: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Times, states (i, w, theta), and how often the plate stuck and struck a stop, under steps of voltage."""
    x, start, way, stuck, struck = np.zeros(3), 0.0, 0, 0, 0
    times, states = [np.zeros(1)], [np.zeros((1, 3))]
    for duration, volts in zip(durations, levels, strict=True):
        t, end = start, start + duration
        while t < end:
            rates, events = slope_of(truth, volts, way), ends_of(truth, way)
            piece = solve_ivp(rates, (t, end), x, "DOP853", events=events, rtol=1e-11, atol=1e-13, max_step=2e-3)
            times.append(piece.t[1:])
            states.append(piece.y.T[1:])
            t, x = piece.t[-1], piece.y[:, -1].copy()
            if piece.status == 1:
                hit = way != 0 and len(piece.t_events[1]) > 0
                x = np.array([x[0], 0.0, (OPEN if way > 0 else 0.0) if hit else x[2]])
                was, way = way, way_from_rest(truth, x[0], x[2], slack=1e-9 if way == 0 else 0.0)
                struck, stuck = struck + hit, stuck + (was != 0 and way == 0 and not hit)
        start = end
    return np.concatenate(times), np.concatenate(states), stuck, struck


@pytest.mark.parametrize("truth", [CONSISTENT, TABLE_2, draw_truth(np.random.default_rng(5))])
def test_agrees_with_scipy_through_stick_slip_and_impact(truth: Truth) -> None:
    rng = np.random.default_rng(3)
    open_at = truth.volts_for(truth.T_PL + truth.T_f + truth.K_s * OPEN)
    pattern = np.array([1.3, 0.5, 1.2, -0.3, 1.3, 0.55, 0.0, 1.8, 1.8, 1.8, 0.5, -0.5, -0.5, -0.5])
    durations, levels = rng.uniform(0.15, 0.4, 14), open_at * pattern * rng.uniform(0.95, 1.05, 14)
    times, states, stuck, struck = reference(truth, durations, levels)
    assert stuck >= 1
    assert struck >= 1
    rising = np.concatenate(([True], np.diff(times) > 0))
    times, states = times[rising], states[rising]
    drive = steps(durations, levels)
    motion = simulate(throttle(truth, NONE), drive, np.minimum(times, drive.time[-1]), angle=0.0)
    assert np.ptp(states[:, 2]) > 1.5
    assert_allclose(motion.angle, states[:, 2], rtol=0, atol=1e-8)
    assert_allclose(motion.current, states[:, 0], rtol=0, atol=1e-6)


# ---- closed forms


def test_current_of_a_held_plate_rises_exponentially() -> None:
    plant, jump = throttle(CONSISTENT, NONE, series_ohm=1.218), 1.23456e-3
    drive = steps(np.array([0.02]), np.array([1.005])).after(jump, 0.02)
    motion = simulate(plant, drive, fine(0.02, 5e-5), angle=0.0, held_until=NEVER)
    since = np.maximum(motion.time - jump, 0.0)
    expected = 1.005 / plant.R * -np.expm1(-since * plant.R / plant.L)
    assert_allclose(motion.current, expected, rtol=0, atol=1e-8)
    assert np.all(motion.speed == 0.0)


def test_released_plate_falls_as_the_first_order_lag_it_is_without_spring() -> None:
    truth, let_go = Truth(J_m=1.4e-6, J_L=6e-4, K_s=0.0), 0.03141
    motion = simulate(terminals_open(truth, NONE), silent(0.4), fine(0.4), angle=OPEN, held_until=let_go)
    since, lag = np.maximum(motion.time - let_go, 0.0), truth.J_eq / truth.B_eq
    fastest = (truth.T_PL - truth.T_f) / truth.B_eq
    expected = OPEN - fastest * (since + lag * np.expm1(-since / lag))
    falling = expected > 0
    assert np.count_nonzero(~falling) > 0
    assert_allclose(motion.angle[falling], expected[falling], rtol=0, atol=1e-9)
    assert np.all(motion.angle[~falling] == 0.0)
    assert np.all(motion.current == 0.0)


def test_motor_alone_reaches_the_speed_of_its_voltage() -> None:
    plant = motor_alone(CONSISTENT, MEDIUM["stribeck_friction"])
    motion = simulate(plant, line([0.0, 1.0], [6.0, 6.0]), fine(1.0, 1e-3), angle=0.0)
    truth = CONSISTENT
    expected = 6.0 * truth.K_m / (truth.R_a * truth.B_m + truth.K_b * truth.K_m)
    assert_allclose(truth.N * motion.speed[-1], expected, rtol=1e-9)


def test_stuck_plate_does_not_creep() -> None:
    truth = CONSISTENT
    almost = truth.volts_for(truth.T_PL + truth.T_f) - 1e-6
    motion = simulate(throttle(truth, NONE), line([0.0, 5.0], [almost, almost]), fine(5.0, 1e-3), angle=0.0)
    assert np.all(motion.angle == 0.0)
    moved = simulate(throttle(truth, NONE), line([0.0, 5.0], [almost + 2e-6] * 2), fine(5.0, 1e-3), angle=0.0)
    assert moved.angle[-1] > 0.0


# ---- conservation of energy


def test_every_joule_of_a_driven_plate_is_accounted_for() -> None:
    truth = CONSISTENT
    balance = truth.volts_for(truth.T_PL + truth.K_s * 0.8)
    m = simulate(throttle(truth, NONE), chirp(2.0, balance, 1.5), fine(2.0, 1e-5), angle=0.8)
    assert np.ptp(m.angle) > 0.2
    assert np.all((m.angle > 0) & (m.angle < OPEN))
    supplied = simpson(m.voltage * m.current, x=m.time)
    lost = simpson(truth.R_a * m.current**2 + truth.B_eq * m.speed**2 + truth.T_f * np.abs(m.speed), x=m.time)
    stored = [stored_energy(truth, m, k) for k in (0, -1)]
    assert_allclose(supplied, lost + stored[1] - stored[0], rtol=1e-7)


def stored_energy(truth: Truth, m: Motion, k: int) -> float:
    coil, flywheel = truth.L_a * m.current[k] ** 2 / 2, truth.J_eq * m.speed[k] ** 2 / 2
    return coil + flywheel + truth.K_s * m.angle[k] ** 2 / 2 + truth.T_PL * m.angle[k]


# ---- beyond Eqs. 1-2, one by one


def plant_with(effects: Effects) -> np.record:
    return record(throttle(CONSISTENT, effects))


def moving(i: float = 0.0, w: float = 0.0, theta: float = 0.0, age: float = 0.0) -> State:
    return at_rest(throttle(CONSISTENT, NONE), theta)._replace(i=i, w=w, age=age)


AT_THE_LOG = ("position_sensor_lag", "position_sensor_nonlinearity", "current_sensor_offset", "channel_delay",
              "sensor_dead_spot", "sensor_hysteresis")  # fmt: skip


@pytest.mark.parametrize("name", [name for name in STRENGTHS if name not in AT_THE_LOG])
def test_steps_are_fine_enough(name: str) -> None:
    rng = np.random.default_rng(8)
    drive, time = random_steps(rng, 1.0, 1.9, 0.9).after(0.05, 1.1), fine(1.0, 1e-3)
    plant = throttle(CONSISTENT, STRENGTHS[name][1])
    usual, finest = (simulate(plant, drive, time, angle=0.2, h_max=h_max) for h_max in (40e-6, 8e-6))
    assert_allclose(usual.angle, finest.angle, rtol=0, atol=2e-6)


def test_limp_home_plate_rests_where_table_1_says() -> None:
    limp = MEDIUM["limp_home_spring"]
    assert resting_angle(CONSISTENT, NONE) == 0.0
    assert_allclose(np.degrees(resting_angle(CONSISTENT, limp)), 9.0, atol=1.0)
    below, above = (spring_torque(plant_with(limp), np.radians(degrees)) for degrees in (7.0, 11.0))
    assert below < -CONSISTENT.T_f
    assert above > CONSISTENT.T_f


def test_friction_formulas_at_points_worked_by_hand() -> None:
    truth = CONSISTENT
    stribeck = plant_with(Effects(stribeck_friction=more.StribeckFriction(0.06, 0.5)))
    rest, half, fast = (friction_limit(stribeck, moving(w=w), 1) - truth.T_f for w in (0.0, -0.5, 50.0))
    assert_allclose([rest, half, fast], [0.06, 0.03, 0.0], atol=1e-5)
    loaded = plant_with(Effects(load_dependent_friction=more.LoadDependentFriction(0.1)))
    held = (truth.T_PL + truth.K_s) / (truth.N * truth.K_m)  # A; the motor balances the spring
    assert_allclose(friction_limit(loaded, moving(i=held, theta=1.0), 1), truth.T_f + 0.1 * 0.512)
    assert_allclose(friction_limit(loaded, moving(theta=1.0), 1), truth.T_f + 0.1 * 0.512 / np.sqrt(2))
    uneven = plant_with(Effects(asymmetric_friction=more.AsymmetricFriction(0.03, 0.01, 0.002, 0.001, 10.0)))
    assert_allclose([friction_limit(uneven, moving(), way) - truth.T_f for way in (1, -1)], [0.03, 0.01])
    assert_allclose([drag(uneven, w) for w in (10.0, -10.0)], [0.01, -0.005])
    spot = plant_with(Effects(friction_spot=more.FrictionSpot(0.06, 0.7, 0.05)))
    assert_allclose([friction_limit(spot, moving(theta=at), 1) - truth.T_f for at in (0.7, 1.2)], [0.06, 0], atol=1e-9)
    drifting = plant_with(Effects(friction_drift=more.FrictionDrift(0.001, 0.0001, 50.0)))
    assert_allclose(friction_limit(drifting, moving(age=4.0), -1), truth.T_f + 0.004 + 0.005)
    dry = plant_with(Effects(motor_coulomb_friction=more.MotorCoulombFriction(0.002, 0.1, 300.0)))
    assert_allclose(motor_friction(dry, 300.0 / truth.N), truth.N * 0.002 * 1.05)
    assert_allclose(friction_limit(dry, moving(), 1), truth.T_f + truth.N * 0.002)


def test_torques_at_points_worked_by_hand() -> None:
    truth = CONSISTENT
    assert_allclose(drag(plant_with(Effects(quadratic_drag=more.QuadraticDrag(2e-4, 2.0))), -10.0), -0.02)
    air = plant_with(Effects(airflow_torque=more.AirflowTorque(0.03, 1.15)))
    curve = np.array([airflow(air, theta) for theta in np.linspace(0, OPEN, 901)])
    assert_allclose([curve.max(), curve[0], curve[-1]], [0.03, 0, 0], atol=1e-7)
    assert_allclose(curve.argmax() / 900, 0.5 ** (1 / 1.15), atol=2e-3)
    heavy = plant_with(Effects(gravity_load=more.GravityLoad(0.03, 0.05)))
    extra = restoring_torque(heavy, 0.05 + np.pi / 6) - spring_torque(heavy, 0.05 + np.pi / 6)
    assert_allclose(extra, 0.015)
    stiff = plant_with(Effects(stiffening_spring=more.StiffeningSpring(0.08)))
    assert_allclose(restoring_torque(stiff, OPEN / 2) - spring_torque(stiff, OPEN / 2), 0.01)
    iron = plant_with(Effects(torque_saturation=more.TorqueSaturation(1.5)))
    small, large = motor_torque(iron, 1e-3), motor_torque(iron, 100.0)
    assert_allclose([small, large], [truth.N * truth.K_m * 1e-3, 1.5], rtol=1e-6)


def test_cogging_repeats_six_times_a_motor_turn() -> None:
    pure = plant_with(Effects(cogging_torque=more.CoggingTorque(0.02, 6.0, 0.7)))
    period = 2 * np.pi / (6 * CONSISTENT.N)
    assert_allclose(cogging(pure, 0.3 + period), cogging(pure, 0.3), rtol=1e-9)
    assert_allclose(cogging(pure, 0.3 + period / 2), -cogging(pure, 0.3), rtol=1e-9)
    real = plant_with(Effects(cogging_torque=more.CoggingTorque(0.02, 6.0, 0.7, 0.1, 0.1)))
    assert abs(cogging(real, 0.3 + period) - cogging(real, 0.3)) > 1e-5
    assert_allclose(cogging(real, 0.3 + 6 * period), cogging(real, 0.3), rtol=1e-9)


def test_voltages_at_points_worked_by_hand() -> None:
    dead = plant_with(Effects(driver_dead_zone=more.DriverDeadZone(0.2)))
    through = [terminal_voltage(dead, v, 0.0) for v in (0.02, 0.2, -2.0)]
    assert_allclose(through, [0.0, 0.2 * (1 - 2 ** (-1 / 6)), -1.8], atol=1e-6)
    for effects, amps in (
        (Effects(brush_voltage_drop=more.BrushVoltageDrop(0.25)), (9.0 - 0.25) / CONSISTENT.R_a),
        (Effects(driver_dead_zone=more.DriverDeadZone(0.2)), (9.0 - 0.2) / CONSISTENT.R_a),
        (Effects(current_limit=more.CurrentLimit(1.5)), (9.0 + 15 * 1.5) / (CONSISTENT.R_a + 15)),
    ):
        held = simulate(throttle(CONSISTENT, effects), line([0.0, 1.0], [9.0, 9.0]), fine(1.0, 1e-2), angle=0.0,
                        held_until=NEVER)  # fmt: skip
        assert_allclose(held.current[-1], amps, rtol=1e-4)
        assert np.all(held.voltage == 9.0)


def test_a_late_driver_acts_at_its_next_period_and_the_log_has_the_command() -> None:
    late = Effects(actuation_delay=more.ActuationDelay(1.02e-3, 1e-4))
    drive = steps(np.array([0.005, 0.02]), np.array([0.0, 2.0]))
    motion = simulate(throttle(CONSISTENT, late), drive, fine(0.02, 5e-6), angle=0.0, held_until=NEVER)
    assert_allclose(motion.time[np.argmax(motion.current > 0.0)], 0.0061, atol=6e-6)
    assert_allclose(motion.time[np.argmax(motion.voltage > 0.0)], 0.005, atol=6e-6)


def test_a_filtered_angle_follows_late_by_its_time_constants() -> None:
    lag = Effects(position_sensor_lag=more.PositionSensorLag(4e-3, 0.25))
    plant = motor_alone(CONSISTENT, NONE)._replace(effects=lag)
    m = simulate(plant, line([0.0, 1.0], [6.0, 6.0]), fine(1.0, 1e-3), angle=0.0)
    assert_allclose(m.angle[-1] - m.sensed[-1], 5e-3 * m.speed[-1], rtol=1e-6)


def test_a_plate_on_bristles_gives_way_and_comes_back() -> None:
    truth, soft = CONSISTENT, Effects(presliding_friction=more.PreslidingFriction(0.01))
    plant = throttle(truth, soft)
    balance, push = truth.volts_for(truth.T_PL + 0.8 * truth.K_s), 0.3 * truth.T_f
    drive = steps(np.ones(3), balance + truth.volts_for(push) * np.array([0.0, 1.0, 0.0]))
    settled, pushed, back = simulate(plant, drive, np.array([0.99, 1.99, 2.99]), angle=0.8).angle
    stiffness = bristle_stiffness(record(plant))
    assert 0.5 * push / stiffness < pushed - settled < 2 * push / stiffness
    assert abs(back - settled) < 0.5 * (pushed - settled)


def test_bristles_carry_all_of_dry_friction_in_steady_motion() -> None:
    truth = Truth(J_m=1.4e-6, J_L=6e-4, K_s=0.0)
    plant = terminals_open(truth, Effects(presliding_friction=more.PreslidingFriction(0.005)))
    far = plant._replace(upper=1e3)
    m = simulate(far, silent(2.0), fine(2.0, 1e-2), angle=30.0)
    assert_allclose(m.speed[-1], (truth.T_f - truth.T_PL) / truth.B_eq, rtol=1e-6)


def test_a_stop_gives_back_what_it_says_until_the_plate_rests() -> None:
    bouncy = Effects(stop_bounce=more.StopBounce(0.5, 60.0))
    m = simulate(terminals_open(CONSISTENT, bouncy), silent(1.0), fine(1.0, 1e-5), angle=OPEN)
    hit = int(np.argmax(m.speed > 0.0))
    before, after = m.speed[hit - 1], m.speed[hit]
    assert_allclose(after, 0.5 * -before / (1 - before / 60), rtol=0.02)
    assert np.all(m.angle >= 0.0)
    assert np.all(m.speed[-100:] == 0.0)


# ---- two bodies


def test_a_motor_in_its_gap_flies_on_when_the_plate_has_landed() -> None:
    gap = Effects(backlash=more.Backlash(np.radians(1.0)))
    m = simulate(terminals_open(CONSISTENT, gap), silent(0.3), fine(0.3), angle=OPEN)
    landed = int(np.argmax(m.angle == 0.0))
    assert m.angle[landed:].max() < 1e-3
    assert np.abs(m.motor_speed[landed + 1 : landed + 50]).min() > 1.0
    assert np.abs(m.motor_speed[-10:]).max() < 0.2
    assert_allclose(m.motor_speed[landed - 20], m.speed[landed - 20], rtol=0.05)


def test_two_bodies_pressed_together_move_as_one() -> None:
    truth, stiff = CONSISTENT, Effects(backlash=more.Backlash(0.01, 3e4))
    ramp = line([0.0, 2.0], [0.0, truth.volts_for(1.2)])
    one, two = (simulate(throttle(truth, e), ramp, fine(2.0, 1e-3), angle=0.0, h_max=1e-5) for e in (NONE, stiff))
    assert np.ptp(one.angle) > 1.0
    assert_allclose(two.angle, one.angle, atol=2e-3)


def test_teeth_make_no_energy() -> None:
    truth = Truth(J_m=1.4e-6, J_L=6e-4, K_s=0.0, T_PL=0.0, T_f=0.1)
    plant = throttle(truth, Effects(backlash=more.Backlash(np.radians(1.0))))
    m = simulate(plant, chirp(2.0, 0.0, 1.2, first=2.0), fine(2.0, 1e-5), angle=0.8)
    assert np.all((m.angle > 0) & (m.angle < OPEN))
    assert np.abs(m.motor_speed - m.speed).max() > 1.0
    motor = truth.N**2 * np.array([truth.J_m, truth.B_m])
    supplied = simpson(m.voltage * m.current, x=m.time)
    dissipated = truth.R_a * m.current**2 + motor[1] * m.motor_speed**2 + truth.B_L * m.speed**2
    lost = simpson(dissipated + truth.T_f * np.abs(m.speed), x=m.time)
    coil, moving_parts = truth.L_a * m.current**2, motor[0] * m.motor_speed**2 + truth.J_L * m.speed**2
    stored = (coil + moving_parts + truth.K_s * m.angle**2) / 2 + truth.T_PL * m.angle
    in_the_teeth = supplied - lost - (stored[-1] - stored[0])
    assert 0.0 < in_the_teeth < 0.05 * lost


def test_winding_warms_to_its_balance_of_loss_and_conduction() -> None:
    heat = more.WindingHeating(0.0039, 0.05, 0.15)
    m = simulate(throttle(CONSISTENT, Effects(winding_heating=heat)), line([0.0, 8.0], [3.0, 3.0]), fine(8.0, 1e-3),
                 angle=0.0, held_until=NEVER)  # fmt: skip
    assert m.warmth[-1] > 5.0
    assert_allclose(m.current[-1], 3.0 / (CONSISTENT.R_a * (1 + 0.0039 * m.warmth[-1])), rtol=1e-6)
    assert_allclose(0.15 * m.warmth[-1], 3.0 * m.current[-1], rtol=1e-6)


# ---- driver, sensors, session


def test_a_wiper_bends_between_its_ends_and_sticks_where_it_is_worn() -> None:
    angle = np.linspace(0, OPEN, 91)
    bent = wiper(Effects(position_sensor_nonlinearity=more.PositionSensorNonlinearity(0.01, 0.005)), angle) - angle
    assert_allclose(bent[[0, 45, 90]], [0.0, 0.01, 0.0], atol=1e-12)
    assert bent[22] > bent[68]
    worn = Effects(sensor_dead_spot=more.SensorDeadSpot(0.5, 0.2))
    assert_allclose(wiper(worn, np.array([0.3, 0.45, 0.55, 0.7, 0.55, 0.45, 0.5])), [0.3, 0.4, 0.4, 0.7, 0.6, 0.6, 0.6])


def test_a_loose_sensor_follows_after_its_play() -> None:
    loose = Effects(sensor_hysteresis=more.SensorHysteresis(0.2))
    assert_allclose(wiper(loose, np.array([0.5, 0.55, 0.7, 0.6, 0.5, 0.4])), [0.5, 0.5, 0.6, 0.6, 0.6, 0.5])


def test_what_comes_and_goes_with_time_at_points_worked_by_hand() -> None:
    tide = plant_with(Effects(friction_tide=more.FrictionTide(0.03, 20.0, 3.0)))
    assert_allclose(friction_limit(tide, moving(age=2.0), 1), CONSISTENT.T_f + 0.03)  # a quarter of its period
    load = plant_with(Effects(supply_cycling=more.SupplyCycling(0.1, 0.8, 0.01, 0.2)))
    assert_allclose([supplied(load, 10.0, age) for age in (0.0, 0.2, 0.4)], [9.0, 9.5, 10.0])


def test_a_rippled_torque_is_in_proportion_to_the_current() -> None:
    plant = plant_with(Effects(torque_ripple=more.TorqueRipple(0.1, 11.0)))
    theta = 0.5 * np.pi / (11.0 * CONSISTENT.N)
    for amps in (0.5, 2.0):
        torque = CONSISTENT.N * CONSISTENT.K_m * amps
        assert_allclose([rippled(plant, moving(i=amps), at) for at in (0.0, theta)], [torque, 1.1 * torque])


def logged(effects: Effects, test: str, series: Series) -> dict[str, np.ndarray]:
    session = Session(np.random.default_rng(0), CONSISTENT, effects, PERFECT)
    return next(iter(PROTOCOLS[test](session, series))).columns


def test_a_current_channel_is_off_and_early_by_what_it_says() -> None:
    series = Series(1, 0.02, 20_000)
    true = logged(NONE, "inductance", series)
    off = logged(Effects(current_sensor_offset=more.CurrentSensorOffset(0.02, 0.0)), "inductance", series)
    late = logged(Effects(channel_delay=more.ChannelDelay(0.5e-3, 0.0)), "inductance", series)
    assert_allclose(off["current [mA]"], true["current [mA]"] + 20.0, atol=1e-3)
    assert_allclose(late["current [mA]"][10:], true["current [mA]"][:-10], atol=1e-3)
    assert_allclose(late["voltage [V]"], true["voltage [V]"])


def test_friction_drifts_on_from_trace_to_trace() -> None:
    session = Session(np.random.default_rng(0), CONSISTENT, MEDIUM["friction_drift"], PERFECT)
    assert [len(list(PROTOCOLS["resistance"](session, Series(2, 0.5, 1000))))] == [2]
    assert session.stopwatch.seconds == 1.0
    worn = session.aged(throttle(CONSISTENT, session.effects)).effects.friction_drift
    assert worn == MEDIUM["friction_drift"].friction_drift._replace(before=1.0)


SHORT = {
    "response": Series(1, 1.0, 1000),
    "back_emf": Series(1, 0.3, 1000),
    "inductance": Series(1, 0.02, 5000),
    "viscous": Series(4, 0.3, 1000),
}


@cache
def noiseless(effects: Effects) -> list[np.ndarray]:
    """Every channel of some short traces over its sensor's noise, in turn."""
    columns = []
    for test, series in SHORT.items():
        session = Session(np.random.default_rng(0), CONSISTENT, effects, PERFECT)
        for trace in PROTOCOLS[test](session, series):
            for header, column in list(trace.columns.items())[1:]:
                noise = Bench().sensors[header.partition(" ")[0]].declared * (1e3 if "[m" in header else 1.0)
                columns.append(column / noise)
    return columns


def change(effects: Effects) -> float:
    """How much it moves the data: mean of |after - before|, each within 100 standard deviations of noise."""
    pairs = zip(noiseless(NONE), noiseless(effects), strict=True)
    apart = [np.minimum(np.abs(b[: len(a)] - a[: len(b)]), 100.0).mean() for a, b in pairs]
    return float(np.mean(apart))


@pytest.mark.slow
@pytest.mark.parametrize("name", STRENGTHS)
def test_each_strength_moves_the_data_more_than_the_one_below(name: str) -> None:
    low, medium, high = (change(effects) for effects in STRENGTHS[name])
    assert 1e-5 < low < medium < high
    assert medium > 0.01


def test_every_name_has_three_strengths_of_its_own() -> None:
    assert set(STRENGTHS) == {*CATALOGUE, *OUTSIDE, *FURTHER} == set(Effects._fields)
    assert (len(CATALOGUE), len(OUTSIDE), len(FURTHER)) == (21, 5, 4)
    for name, levels in STRENGTHS.items():
        assert len(set(levels)) == 3
        assert all(effects.on == (name,) for effects in levels)
    assert NONE.on == ()


def test_effects_combine_but_never_one_with_itself() -> None:
    both = combine(MEDIUM["backlash"], MEDIUM["brush_voltage_drop"])
    assert set(both.on) == {"backlash", "brush_voltage_drop"}
    assert both.backlash == MEDIUM["backlash"].backlash
    with pytest.raises(ValueError, match="on in both: backlash"):
        combine(both, MEDIUM["backlash"])


# ---- truths, instruments, folders


def test_drawn_truths_fill_the_band_and_let_the_plate_return() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_truth(rng) for _ in range(400)]
    for name, centre in asdict(CONSISTENT).items():
        ratios = np.array([getattr(truth, name) for truth in drawn]) / centre
        assert np.all(np.abs(ratios - 1) <= 0.4)
        assert name == "N" or np.ptp(ratios) > 0.7
    assert all(truth.K_m == truth.K_b for truth in drawn)
    assert all(resting_angle(truth, NONE) == 0.0 for truth in drawn[:40])


def test_the_clock_samples_beside_the_times_it_logs() -> None:
    ticks = clock(np.random.default_rng(2), Bench(), 1000.0, 5.0)
    assert_allclose(ticks.logged, np.arange(5000) * 1e-3, rtol=0, atol=1e-12)
    assert_allclose(np.std(ticks.true - ticks.logged), 1e-5, rtol=0.05)
    assert np.all(np.diff(ticks.true) > 0)


def test_a_slow_amplifier_turns_a_jump_into_a_slope() -> None:
    slow = steps(np.array([1.0, 1.0]), np.array([0.0, 2.0])).slewed(0.1)
    assert_allclose(np.interp([0.99, 1.05, 1.1], slow.time, slow.volts), [0.0, 1.0, 2.0])


def table(file: Path) -> tuple[list[str], np.ndarray]:
    first, header, *_ = file.read_text(encoding="utf-8").split("\n", 2)
    assert first.startswith("# SYNTHETIC: made by independent, seed ")
    return header.split(","), np.loadtxt(file, delimiter=",", skiprows=2)


def test_a_folder_scatters_as_its_rig_toml_says(tmp_path: Path) -> None:
    make_folder(tmp_path, CONSISTENT, seed=4)
    noise = tomllib.loads((tmp_path / "rig.toml").read_text(encoding="utf-8"))["noise"]
    _, held = table(tmp_path / "resistance" / "volts_7.csv")
    assert_allclose(held[:, 1:].std(axis=0), [noise["voltage_V"], noise["current_A"]], rtol=0.12)
    assert_allclose(held[:, 1].mean() / held[:, 2].mean(), CONSISTENT.R_a, rtol=1e-3)
    _, landed = table(tmp_path / "back_emf" / "release_1.csv")
    assert_allclose(landed[-300:, 1:].std(axis=0), [noise["emf_V"], noise["tps_V"]], rtol=0.15)
    _, running = table(tmp_path / "viscous" / "volts_6.csv")
    assert_allclose(running[-600:, 3].std(), noise["motor_speed_rpm"], rtol=0.12)


@pytest.mark.slow
def test_what_the_body_itself_leaves_is_its_sensors_noise_and_what_a_noisy_voltage_adds() -> None:
    """Under a voltage logged without noise and on time, only the noise of the channel itself is left."""
    quiet = {"voltage": Sensor("voltage", "V", 0.0, 1e-9)}
    exact = Bench(Bench().sensors | quiet, jitter=0.0)
    wild = Bench(Bench().sensors | {"voltage": Sensor("voltage", "V", 0.2, 1e-9)}, jitter=0.0)
    for name in ("presliding_friction", "actuation_delay", "channel_delay", "friction_drift"):
        left, more_so = (left_by_itself(CONSISTENT, 3, MEDIUM[name], "small", bench) for bench in (exact, wild))
        assert left.keys() == {(f"{f}.csv", of) for f in ("static_load/ramp_2", "response/drive_3")
                               for of in ("voltage", "current", "tps")}  # fmt: skip
        ramp = [("static_load/ramp_2.csv", of) for of in ("current", "tps")]  # without a jump between two samples
        assert_allclose([left[of] for of in ramp], 1.0, rtol=0.06)
        assert all(more_so[of] > 1.5 for of in ramp)


def test_a_folder_holds_every_test_and_names_what_it_holds_out(tmp_path: Path) -> None:
    make_folder(tmp_path, TABLE_2, seed=1, size="small")
    rig = tomllib.loads((tmp_path / "rig.toml").read_text(encoding="utf-8"))
    assert rig["rig"]["synthetic"] is True
    assert "synthetic" in rig["rig"]["name"]
    assert {folder.name for folder in tmp_path.iterdir() if folder.is_dir()} == set(SIZES["small"])
    assert [file.partition("/")[0] for file in rig["holdout"]["files"]] == ["response", "static_load"]
    assert all((tmp_path / file).is_file() for file in rig["holdout"]["files"])
    for file in tmp_path.glob("*/*.csv"):
        header, rows = table(file)
        assert header[0].startswith("time [")
        assert np.all(np.diff(rows[:, 0]) > 0)
        assert np.all(np.isfinite(rows))


@pytest.mark.parametrize("seed", range(4))
def test_every_protocol_makes_sense_of_the_truth_it_meets(tmp_path: Path, seed: int) -> None:
    truth = draw_truth(np.random.default_rng(seed), (CONSISTENT, TABLE_2)[seed % 2])
    make_folder(tmp_path, truth, seed, size="small")
    closed, opened = 0.47, 4.71
    releases = [*tmp_path.glob("back_emf/*.csv"), *tmp_path.glob("inertia/*.csv")]
    ramps = [*tmp_path.glob("static_load/*.csv")]
    assert (len(releases), len(ramps)) == (2, 2)
    for release in releases:
        tps = table(release)[1][:, 2]
        assert tps[:10].mean() > opened
        assert tps[-10:].mean() < closed
    for ramp in ramps:
        tps = table(ramp)[1][:, 3]
        assert tps[:10].mean() < closed
        assert tps.max() > opened
        assert tps[-10:].mean() < closed


def test_a_folder_to_diagnose_holds_out_two_kinds_of_drive(tmp_path: Path) -> None:
    effects = combine(MEDIUM["backlash"], MEDIUM["limp_home_spring"])
    make_folder(tmp_path, CONSISTENT, seed=1, effects=effects, size="diagnose")
    rig = tomllib.loads((tmp_path / "rig.toml").read_text(encoding="utf-8"))
    held = rig["holdout"]["files"]
    assert held == ["response/drive_5.csv", "response/drive_6.csv", "static_load/ramp_3.csv"]
    assert all((tmp_path / file).is_file() for file in held)
    known = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))["effects"]
    assert known == {name: getattr(effects, name)._asdict() for name in ("limp_home_spring", "backlash")}
    samples = sum(len(table(file)[1]) for file in tmp_path.glob("*/*.csv"))
    assert 12_000 < samples < 16_000


def test_driven_traces_move_reverse_and_stick() -> None:
    session = Session(np.random.default_rng(0), CONSISTENT, NONE, PERFECT)
    traces = [trace.columns["tps [V]"] for trace in response(session, Series(4, 4.0, 1000))]
    assert min(np.ptp(tps) for tps in traces) > 1.0
    rates = [np.diff(tps) for tps in traces]
    assert all((rate > 1e-4).any() and (rate < -1e-4).any() for rate in rates)
    assert all(np.mean(np.abs(rate) < 1e-8) > 0.05 for rate in rates)


def test_a_seed_is_a_folder(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        make_folder(tmp_path / name, CONSISTENT, seed, size="small", holdout=False, declare_noise=False)
    a, b, c = ((tmp_path / name / "response" / "drive_1.csv").read_bytes() for name in "abc")
    assert a == b
    assert a != c
    rig = tomllib.loads((tmp_path / "a" / "rig.toml").read_text(encoding="utf-8"))
    assert rig.keys() == {"rig", "tps", "tests"}


def test_the_twin_is_the_committed_one_and_keeps_its_secret_and_its_size(tmp_path: Path) -> None:
    bench_twin.main(tmp_path)
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    committed = Path(__file__).parents[1] / "measurements" / "bench_twin"
    assert {file.relative_to(tmp_path) for file in files} == {
        file.relative_to(committed) for file in committed.rglob("*") if file.is_file()
    }
    for file in files:
        assert file.read_bytes() == (committed / file.relative_to(tmp_path)).read_bytes(), file.name
    assert sum(file.stat().st_size for file in files) < 2_000_000
    assert not (tmp_path / "truth.json").exists()
    words = "".join(file.read_text(encoding="utf-8") for file in files).lower()
    assert not [effect for effect in MEDIUM if effect in words or effect.replace("_", " ") in words]


def test_nothing_here_imports_the_package_under_test() -> None:
    files = [*PACKAGE.rglob("*.py")]
    assert PACKAGE / "simulate.py" in files
    for file in files:
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not [name for name in names if "etcfit" in name]


@pytest.mark.parametrize("ohm", [0.0, 0.4])
def test_a_bridge_gives_its_duty_of_what_its_supply_has_left(ohm: float) -> None:
    plant, rate, supply = throttle(CONSISTENT, NONE), 1000.0, 12.0
    duty = duty_of(line([0.0, 0.02, 0.0201, 0.06], [1.0, 4.0, -3.0, -2.0]), rate, 60, supply)
    drive = fed(plant, duty, rate, supply, ohm, 0.5)
    instants = np.arange(0.00025, 0.0595, 1e-3)  # within ticks
    motion = simulate(plant, drive, instants, angle=0.5)
    held = duty[(instants * rate).astype(int)]
    assert np.ptp(motion.current) > 2.0
    assert_allclose(motion.voltage, held * (supply - ohm * held * motion.current), atol=2e-3)


def test_late_columns_are_rows_behind_the_others() -> None:
    rows = np.arange(8.0)[:, None] + np.array([0.0, 10.0, 20.0])
    sheet = shifted(Sheet("#", ("time [s]", "voltage [V]", "current [A]"), rows), [2], 3)
    assert_allclose(sheet.rows, rows[3:] - np.array([0.0, 0.0, 3.0]))
