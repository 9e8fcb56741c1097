"""The three gains and the ECU's tick: textbook forms, anti-windup, and the published sources of ECUs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import rigs
from etcfit.control.pid.linear_loop import margins, respond
from etcfit.control.setpoint import trapezoid
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.ecus import ARDUINO, FOME, GENERIC, RUSEFI, EcuProfile, differences
from etcfit.model.pid import Gains, Memory, tick
from firmwares import Firmware, Fome, PidV1, Rusefi, Settings, Textbook

S = 1j * np.geomspace(0.1, 100.0, 7)  # 1/s


@pytest.mark.parametrize(("k", "ti", "td"), [(3.0, 0.5, 0.05), (0.2, 4.0, 1.0)])
def test_standard_and_series_form_are_the_sum_of_three_terms(k: float, ti: float, td: float) -> None:
    def total(gains: Gains) -> np.ndarray:
        return np.asarray(gains.Kp + gains.Ki / S + gains.Kd * S)

    assert_allclose(total(Gains.standard(k, ti, td)), k * (1.0 + 1.0 / (ti * S) + td * S), rtol=1e-12)
    assert_allclose(total(Gains.series(k, ti, td)), k * (1.0 + 1.0 / (ti * S)) * (1.0 + td * S), rtol=1e-12)


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


TRAVEL = np.pi / 2
PLAIN = Settings(8.0, 120.0, 0.08)
BIASED = Settings(8.0, 120.0, 0.08, [0.0, 9.5, 10.5, 100.0], [-20.0, -15.0, 15.0, 30.0])


@dataclass
class Case:
    make: EcuProfile
    firmware: type[Firmware]
    duty: float
    integral: float | None  # %, that it must have met


CASES = {
    case.make.name: case
    for case in (Case(RUSEFI, Rusefi, 90.0, 30.0), Case(FOME, Fome, 90.0, 30.0),
                 Case(ARDUINO, PidV1, 100.0, 100.0), Case(GENERIC, Textbook, 100.0, None))
}  # fmt: skip


def drive(make: EcuProfile, firmware: Firmware, supply: float, seed: int) -> tuple[list[float], ...]:
    """Duties of ours and of theirs over a random sequence that throws both to their limits."""
    ecu, typed = Ecu(supply=supply)._replace(**make.completed({})), firmware.settings
    assert make.notation is not None
    unit = make.notation.units(ecu, TRAVEL)
    gains = Gains(typed.p * unit.P, typed.i * unit.I, typed.d * unit.D)
    rng = np.random.default_rng(seed)
    targets = np.repeat(rng.uniform(0.0, 100.0, 12), 60)
    targets[-120:] = 90.0  # held, far off: integrals meet their limits
    positions = np.clip(targets + 20.0 * np.cumsum(rng.standard_normal(targets.size)) / 30.0, 0.0, 100.0)
    positions[-120:] = 78.0
    targets[0] = positions[0]
    memory, ours, theirs = Memory.at_rest(gains, ecu, positions[0] * TRAVEL / 100.0), [], []
    for target, position in zip(targets, positions, strict=True):
        bias = typed.ahead(target) * supply / 100.0
        volts, memory = tick(gains, ecu, memory, target * TRAVEL / 100.0, position * TRAVEL / 100.0, bias)
        ours.append(100.0 * float(volts) / supply)
        theirs.append(firmware.update(target, position))
    return ours, theirs


@pytest.mark.slow
@pytest.mark.parametrize("biased", [True, False])
@pytest.mark.parametrize(("supply", "seed"), [(12.0, 1), (14.2, 2)])
@pytest.mark.parametrize("name", CASES)
def test_it_puts_out_what_its_source_puts_out(name: str, supply: float, seed: int, biased: bool) -> None:
    case = CASES[name]
    firmware = case.firmware(BIASED if biased and case.make.bias is not None else PLAIN)
    ours, theirs = drive(case.make, firmware, supply, seed)
    assert np.allclose(ours, theirs, rtol=0.0, atol=1e-9)
    # every limit was met
    assert max(np.abs(theirs)) == pytest.approx(case.duty)
    assert max(np.abs(firmware.asked)) > 100.0
    if case.integral is not None:
        assert max(np.abs(firmware.held)) == pytest.approx(case.integral)
    assert np.ptp(theirs) > 100.0


def test_another_controller_puts_out_something_else() -> None:
    """What a profile says matters: one controller's gains in another are off by far."""
    for other in (RUSEFI, GENERIC):
        ours, theirs = drive(other, PidV1(PLAIN), 12.0, 1)
        assert np.max(np.abs(np.array(ours) - theirs)) > 5.0


def test_an_ecu_differs_in_what_it_does_not_share() -> None:
    fixes = RUSEFI.fixes
    assert differences(Ecu(), fixes) == ("period", "filter", "duty", "integral")
    assert differences(Ecu()._replace(**fixes), fixes) == ()
    assert differences(Ecu(supply=14.0, delay=1e-3)._replace(**fixes)._replace(integral=0.2), fixes) == ("integral",)
    assert differences(Ecu()._replace(**fixes)._replace(slew=50.0), fixes) == ("slew",)


def test_rusefis_gains_are_in_percent_and_of_continuous_time() -> None:
    assert RUSEFI.notation == FOME.notation == Notation("%", "%", "seconds")
