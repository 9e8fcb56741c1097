"""One tick of the PID, each of its habits by itself, against the arithmetic done here by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rigs
from etcfit.control.pid import Gains
from etcfit.control.pid.ecu import Memory, tick
from etcfit.control.pid.linear_loop import respond
from etcfit.control.pid.margins import margins
from etcfit.control.pid.setpoint import trapezoid
from etcfit.model.ecu import Ecu

GAINS = Gains(2.0, 50.0, 0.01)
WIDE = Ecu(supply=1e9, filter=1e-3)


def ticked(ecu: Ecu, wanted: list[float], seen: list[float], gains: Gains = GAINS) -> list[float]:
    memory, out = Memory.at_rest(gains, ecu, seen[0]), []
    for setpoint, position in zip(wanted, seen, strict=True):
        volts, memory = tick(gains, ecu, memory, setpoint, position, 0.0)
        out.append(float(volts))
    return out


def test_a_derivative_of_the_position_alone_gives_no_kick() -> None:
    # P 2 e, I 50 T sum e; D 0.01 (-y + y_last) / (T_f + T), its filter's memory halved by the tick
    ecu = WIDE._replace(derivative_weight=0.0)
    found = ticked(ecu, [0.5, 0.6, 0.6], [0.5, 0.5, 0.52])
    assert found == pytest.approx([0.0, 0.2 + 0.005, 0.16 + 0.009 - 0.01 * 0.02 / 2e-3])
    assert ticked(WIDE, [0.5, 0.6], [0.5, 0.5])[1] == pytest.approx(0.2 + 0.005 + 0.01 * 0.1 / 2e-3)


def test_a_proportional_part_of_the_position_alone_waits_for_the_integral() -> None:
    ecu = WIDE._replace(setpoint_weight=0.0, derivative_weight=0.0)
    assert ticked(ecu, [0.5, 0.6, 0.6], [0.5, 0.5, 0.5]) == pytest.approx([0.0, 0.005, 0.010])
    half = WIDE._replace(setpoint_weight=0.5, derivative_weight=0.0)
    assert ticked(half, [0.5, 0.6], [0.5, 0.5]) == pytest.approx([0.0, 0.1 + 0.005])


def test_the_integral_stands_still_within_its_dead_band() -> None:
    ecu = WIDE._replace(dead_band=0.05)
    slow = GAINS._replace(Kd=0.0)
    assert ticked(ecu, [0.04, 0.06, -0.04], [0.0] * 3, slow) == pytest.approx([0.08, 0.12 + 0.003, -0.08 + 0.003])


def test_the_output_goes_no_faster_than_its_slew_and_the_integral_waits() -> None:
    ecu = Ecu(supply=12.0, filter=0.0, slew=100.0)
    still = Gains(10.0, 1000.0, 0.0)
    wanted = [0.1] * 5 + [0.0] * 15
    found = np.diff(ticked(ecu, wanted, [0.0] * 20, still), prepend=0.0)
    assert np.max(np.abs(found)) == pytest.approx(0.1)
    assert found[:5] == pytest.approx(0.1)
    # it asked for more than it could have at once in all five ticks: its integral is still empty
    assert ticked(ecu, wanted, [0.0] * 20, still)[-1] == pytest.approx(0.0)
    assert ticked(ecu._replace(slew=0.0), wanted, [0.0] * 20, still)[-1] == pytest.approx(0.5)


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.4, 0.3), (0.0, 0.0)])
def test_the_linear_loop_follows_as_the_simulated_one_does(weights: tuple[float, float]) -> None:
    """Round a plant that is linear; its setpoint begins off zero, where the weights must not jolt it."""
    p, d = weights
    ecu = WIDE._replace(setpoint_weight=p, derivative_weight=d, filter=2e-3)
    loop = rigs.loop(ecu=ecu, body=rigs.WIDE, T_f=0.0, T_PL=0.0, K_s=0.0)
    ramp = trapezoid(0.0, 0.4, lead=0.2)
    wide = replace(ramp, shares=tuple(0.6 + 1e-3 * share for share in ramp.shares))
    gains = (40.0, 400.0, 0.3)
    there = respond(rigs.plant(loop), Gains(*gains), ecu, wide)
    here = np.asarray(loop.share(loop.respond(rigs.one(*gains), wide).position))[0, 0]
    assert np.ptp(there) > 2e-4
    assert np.max(np.abs(here - there)) < 3e-3 * np.ptp(there)
    whole = respond(rigs.plant(loop), Gains(*gains), WIDE._replace(filter=2e-3), wide)
    assert np.max(np.abs(whole - there)) > 0.02 * np.ptp(there)


def test_the_weights_of_the_setpoint_leave_the_margins_alone() -> None:
    loop = rigs.loop(ecu=Ecu())
    gains, plant = Gains(40.0, 400.0, 0.3), rigs.plant(loop)
    weighed = Ecu(setpoint_weight=0.2, derivative_weight=0.0)
    assert margins(gains, plant, weighed) == margins(gains, plant, Ecu())
