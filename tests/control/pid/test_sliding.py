"""Feed-forward of friction and rate: its numbers by Eqs. 1-2, and what it does to the independent throttle body."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

import rigs
from etcfit.control.pid.loop import Loop
from etcfit.control.pid.setpoint import trapezoid
from etcfit.control.pid.sliding import Sliding, rates, sliding_of
from etcfit.control.settings import SlidingSettings
from etcfit.model.ecu import Ecu
from etcfit.model.effects.asymmetric_friction import AsymmetricFriction
from etcfit.model.effects.limp_home_spring import LimpHomeSpring
from etcfit.model.effects.stribeck_friction import StribeckFriction
from etcfit.model.feed_forward import Term
from independent.bench_twin import TRUTH, UNDECLARED
from independent.control import Computer, helped
from independent.effects import NONE
from independent.simulate import throttle
from independent.truth import OPEN, Truth, draw_truth

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
