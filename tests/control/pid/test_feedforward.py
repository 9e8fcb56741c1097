"""Feed-forward: the bias curve on the corners of a limp-home spring, and what a moving plate takes."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

import rigs
from etcfit.control.pid.feedforward import Sliding, bias_of, held, hold_curve, polygon, rates, sliding_of
from etcfit.control.pid.loop import Loop
from etcfit.control.setpoint import trapezoid
from etcfit.control.settings import SlidingSettings
from etcfit.model.ecu import Ecu
from etcfit.model.effects.friction import AsymmetricFriction, StribeckFriction
from etcfit.model.effects.springs import LimpHomeSpring
from etcfit.model.feed_forward import Term
from independent.bench_twin import TRUTH, UNDECLARED
from independent.control import Computer, helped
from independent.effects import NONE
from independent.simulate import throttle
from independent.truth import OPEN, Truth, draw_truth

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


def test_however_many_angles_there_are_each_is_held_by_itself() -> None:
    loop = rigs.loop(ecu=Ecu())
    angles = loop.angle(np.linspace(0.0, 1.0, 1030))
    together = held(loop.nominal, angles, 1.0, *loop.body)
    for k in (0, 511, 512, 1029):
        alone = held(loop.nominal, angles[k : k + 1], 1.0, *loop.body)
        assert [each[k] for each in together] == [pytest.approx(each[0], rel=1e-14) for each in alone]


ECU = Ecu(period=1e-3, supply=12.0, filter=2e-3)
GAINS = Computer(60.0, 300.0, 0.6)
TRUTHS = [TRUTH, *(draw_truth(np.random.default_rng(seed)) for seed in (1, 2, 3))]


def loop_of(truth: Truth) -> Loop:
    """Our model with the true parameters."""
    given = {symbol: value for symbol, value in asdict(truth).items() if symbol != "N"}
    return rigs.loop(ecu=ECU, **given)


def found_for(truth: Truth) -> Sliding:
    model = loop_of(truth)
    return sliding_of(model.nominal, *model.body)


def saw(rate: float) -> np.ndarray:
    """Up and down between 15 and 75 % of the travel without a rest, rad a tick of 1 ms; rate in rad/s."""
    edge = 0.6 * OPEN / rate
    corners = 0.3 + edge * np.arange(7)
    return np.interp(
        1e-3 * np.arange(round(1e3 * corners[-1])), [0.0, *corners], OPEN * np.array([0.15] + [0.15, 0.75] * 3 + [0.15])
    )


@pytest.mark.parametrize("truth", TRUTHS)
def test_the_terms_are_those_of_the_true_parameters(truth: Truth) -> None:
    """At a constant speed Eq. 1 leaves R_a i + N K_b w, and Eq. 2 N K_m i = B w + T_f + spring."""
    found = found_for(truth)
    assert found.opening == pytest.approx(truth.volts_for(truth.T_f), rel=1e-6)
    assert found.closing == pytest.approx(truth.volts_for(truth.T_f), rel=1e-6)
    assert found.slope == pytest.approx(truth.N * truth.K_b + truth.volts_for(truth.B_eq), rel=1e-6)
    assert found.full == pytest.approx(0.05 * OPEN)


def test_friction_is_that_of_the_speed_and_not_of_the_rest() -> None:
    """Stribeck's excess is gone at the trapezoid's rate, and at a crawl it is all there."""
    per_torque = 1.513 / (20.68 * 0.0189)
    model = rigs.loop(StribeckFriction, ecu=ECU, T_s=0.2, omega_s=0.05)
    fast = sliding_of(model.nominal, *model.body)
    slow = sliding_of(model.nominal, *model.body, SlidingSettings(rate=1e-3))
    assert fast.opening == pytest.approx(per_torque * 0.239, rel=0.02)
    assert slow.opening == pytest.approx(per_torque * 0.439, rel=0.02)


def test_a_shift_of_the_preload_is_the_springs_and_no_friction() -> None:
    plain, shifted = (rigs.loop(AsymmetricFriction, ecu=ECU, T_a=shift) for shift in (0.0, 0.1))
    found, expected = (asdict(sliding_of(each.nominal, *each.body)) for each in (shifted, plain))
    assert found == pytest.approx(expected, rel=1e-9)
    assert shifted.holds(np.array([0.5])).middle[0] > plain.holds(np.array([0.5])).middle[0] + 0.1


def test_the_limp_home_spring_is_in_none_of_them() -> None:
    with_spring = rigs.loop(LimpHomeSpring, ecu=ECU, T_lh=0.3, K_lh=0.8, theta_lh=0.16)
    plain = rigs.loop(ecu=ECU)
    ours, theirs = (asdict(sliding_of(each.nominal, *each.body)) for each in (with_spring, plain))
    assert ours == pytest.approx(theirs, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.6, 3.0])
@pytest.mark.parametrize("truth", TRUTHS)
def test_the_independent_plate_follows_a_ramp_more_closely(truth: Truth, rate: float) -> None:
    """Their plant with its limp-home spring, their integrator, their computer; of ours the voltage ahead alone."""
    plant, wanted, sliding = throttle(truth, UNDECLARED), saw(rate), found_for(truth)
    begins = 300

    def error(terms: Sliding | None) -> float:
        ahead = np.zeros(wanted.size) if terms is None else terms.volts(rates(wanted, ECU))
        angle, _ = helped(plant, GAINS, wanted, ahead)
        return float(np.sqrt(np.mean((angle - wanted)[begins:] ** 2)))

    alone, friction, rated = (error(sliding.only(t)) for t in ((), (Term.FRICTION,), (Term.RATE,)))
    both = error(sliding)
    assert friction < 0.85 * alone
    assert rated < 0.85 * alone
    assert both < 0.35 * alone
    assert both < 0.8 * min(friction, rated)
    # other numbers are worse: twice the friction, the other way round, another motor's back-EMF
    for wrong in (
        replace(sliding, opening=2.0 * sliding.opening, closing=2.0 * sliding.closing),
        replace(sliding, opening=-sliding.opening, closing=-sliding.closing),
        replace(sliding, slope=2.0 * sliding.slope),
        replace(sliding, slope=-sliding.slope),
    ):
        assert error(wrong) > 1.2 * both


def test_the_simulated_loop_puts_out_what_is_written_by_hand() -> None:
    """The same plant and PID twice; theirs gets the voltage ahead by the formula, tick by tick."""
    truth = TRUTHS[1]
    loop, wanted = loop_of(truth), trapezoid(lead=0.3)
    time = wanted.instants(ECU.period)
    asked = OPEN * wanted.at(time)
    ahead, rate = np.zeros(asked.size), 0.0
    friction = truth.R_a * truth.T_f / (truth.N * truth.K_m)
    slope = truth.N * truth.K_b + truth.R_a * truth.B_eq / (truth.N * truth.K_m)
    for k in range(1, asked.size):
        rate = (2e-3 * rate + asked[k] - asked[k - 1]) / 3e-3
        ahead[k] = friction * min(max(rate / (0.05 * OPEN), -1.0), 1.0) + slope * rate
    theirs, _ = helped(throttle(truth, NONE), GAINS, asked, ahead)
    gains = rigs.one(GAINS.proportional, GAINS.integral, GAINS.derivative)
    ours, unhelped = (
        np.asarray(each.respond(gains, wanted).position)[0, 0]
        for each in (replace(loop, sliding=found_for(truth)), loop)
    )
    assert np.max(np.abs(ours - theirs)) < 0.004 * OPEN
    assert np.max(np.abs(unhelped - theirs)) > 0.03 * OPEN


@pytest.mark.parametrize("slow", [0.0, 2e-3])
def test_the_rate_is_that_of_the_setpoint_behind_its_filter(slow: float) -> None:
    ecu, time = Ecu(period=1e-3, filter=slow), 1e-3 * np.arange(200)
    assert rates(2.0 * time, ecu)[-1] == pytest.approx(2.0, rel=1e-9)
    assert rates(np.full(200, 0.7), ecu) == pytest.approx(np.zeros(200))
    # a step passes it once, however long it takes
    step = np.where(time < 0.05, 0.2, 0.6)
    assert 1e-3 * np.sum(rates(step, ecu)) == pytest.approx(0.4)
    assert np.max(rates(step, ecu)) == pytest.approx(0.4 / (slow + 1e-3))


def test_a_setpoint_that_flickers_gets_its_share_of_the_friction() -> None:
    sliding = Sliding(opening=1.0, closing=0.6, full=0.1, slope=0.0)
    assert sliding.volts(np.array([0.0, 0.05, 0.1, 3.0])) == pytest.approx([0.0, 0.5, 1.0, 1.0])
    assert sliding.volts(-np.array([0.0, 0.05, 0.1, 3.0])) == pytest.approx([0.0, -0.3, -0.6, -0.6])
