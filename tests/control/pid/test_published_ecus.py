"""Throttle controllers whose source is public, put down here in their own units from that source, against our tick."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pytest

from etcfit.control.pid import Gains
from etcfit.control.pid.ecu import Memory, tick
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.ecus import ARDUINO, FOME, GENERIC, RUSEFI, EcuProfile, differences

TRAVEL = np.pi / 2
BINS, VALUES = [0.0, 9.5, 10.5, 100.0], [-20.0, -15.0, 15.0, 30.0]
P, I, D = 8.0, 120.0, 0.08  # noqa: E741


class Firmware(Protocol):
    """What it makes of target and position (%), duty in %."""

    asked: list[float]  # what its PID made before any clamp
    held: list[float]  # its integral

    def update(self, target: float, position: float) -> float: ...


def clamp(low: float, value: float, high: float) -> float:
    return min(max(value, low), high)


@dataclass
class Rusefi:
    """electronic_throttle.cpp and efi_pid.cpp: 500 Hz. EtbController::update is getOpenLoop + getClosedLoop."""

    biased: bool
    previous: float = 0.0
    i_term: float = 0.0
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        error, dt = target - position, 1.0 / 500.0
        self.i_term += I * dt * error
        if self.i_term > 100.0 * 100.0:  # maxValue * 100
            self.i_term = 100.0 * 100.0
        self.i_term = clamp(-30.0, self.i_term, 30.0)
        d_term = D / dt * (error - self.previous)
        self.previous = error
        self.asked.append(P * error + self.i_term + d_term)
        self.held.append(self.i_term)
        opened = float(np.interp(target, BINS, VALUES)) if self.biased else 0.0
        return 100.0 * clamp(-0.9, 0.01 * (opened + clamp(-100.0, self.asked[-1], 100.0)), 0.9)


@dataclass
class Fome:
    """electronic_throttle.cpp (getClosedLoop, setOutput) and efi_pid.cpp of FOME, line by line; the bias as its table
    holds it, in steps of 0.5 % and 0.1 %."""

    biased: bool
    iTerm: float = 0.0
    previousError: float = 0.0
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        d_time = 1.0 / 500
        error = (target - position) * 1.0
        p_term = P * error
        self.update_i_term(I * d_time * error)
        d_term = D / d_time * (error - self.previousError)
        self.previousError = error
        output = p_term + self.iTerm + d_term + 0.0
        self.asked.append(output)
        self.held.append(self.iTerm)
        if output > 100.0:
            output = 100.0
        elif output < -100.0:
            output = -100.0
        bins, values = [0.5 * round(b / 0.5) for b in BINS], [0.1 * round(v / 0.1) for v in VALUES]
        open_loop = float(np.interp(target, bins, values)) if self.biased else 0.0
        return clamp(-0.9, 0.01 * (open_loop + output), 0.9) * 100.0

    def update_i_term(self, value: float) -> None:
        self.iTerm += value
        for low, high in ((-100.0 * 100.0, 100.0 * 100.0), (-30.0, 30.0)):
            self.iTerm = high if self.iTerm > high else low if self.iTerm < low else self.iTerm


@dataclass
class PidV1:
    """PID_v1.cpp, `Compute`, with SetSampleTime(1), SetOutputLimits(-100, 100) and P on error. A sketch has no bias."""

    biased: bool
    output_sum: float = 0.0
    last_input: float | None = None
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        sample_time = 0.001
        if self.last_input is None:  # SetMode(AUTOMATIC) -> Initialize
            self.last_input = position
        error, d_input = target - position, position - self.last_input
        self.output_sum = clamp(-100.0, self.output_sum + I * sample_time * error, 100.0)
        self.asked.append(P * error + self.output_sum - D / sample_time * d_input)
        self.held.append(self.output_sum)
        self.last_input = position
        return clamp(-100.0, self.asked[-1], 100.0)


@dataclass
class Textbook:
    """Astrom and Hagglund 2006, ch. 13, backward differences; the integral stands still at the limit (ch. 3.5)."""

    biased: bool
    integral: float = 0.0
    slope: float = 0.0
    last: float = 0.0
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        h, lag, error = 1e-3, 2e-3, target - position
        self.slope = lag / (lag + h) * self.slope + D / (lag + h) * (error - self.last)
        self.last = error
        ahead = float(np.interp(target, BINS, VALUES)) if self.biased else 0.0
        tried = self.integral + I * h * error
        self.asked.append(P * error + tried + self.slope)
        duty = clamp(-100.0, clamp(-100.0, self.asked[-1], 100.0) + ahead, 100.0)
        if not (duty != self.asked[-1] + ahead and (self.asked[-1] + ahead - duty) * error > 0.0):
            self.integral = tried
        self.held.append(self.integral)
        return duty


@dataclass
class Case:
    make: EcuProfile
    firmware: type[Rusefi | Fome | PidV1 | Textbook]
    duty: float
    integral: float | None  # %, that it must have met


CASES = {
    case.make.name: case
    for case in (Case(RUSEFI, Rusefi, 90.0, 30.0), Case(FOME, Fome, 90.0, 30.0),
                 Case(ARDUINO, PidV1, 100.0, 100.0), Case(GENERIC, Textbook, 100.0, None))
}  # fmt: skip


def drive(make: EcuProfile, firmware: Firmware, supply: float, biased: bool, seed: int) -> tuple[list[float], ...]:
    """Duties of ours and of theirs over a random sequence that throws both to their limits."""
    ecu = Ecu(supply=supply)._replace(**make.completed({}))
    unit = make.notation.units(ecu, TRAVEL)
    gains = Gains(P * unit.P, I * unit.I, D * unit.D)
    rng = np.random.default_rng(seed)
    targets = np.repeat(rng.uniform(0.0, 100.0, 12), 60)
    targets[-120:] = 90.0  # held, far off: integrals meet their limits
    positions = np.clip(targets + 20.0 * np.cumsum(rng.standard_normal(targets.size)) / 30.0, 0.0, 100.0)
    positions[-120:] = 78.0
    targets[0] = positions[0]
    memory, ours, theirs = Memory.at_rest(gains, ecu, positions[0] * TRAVEL / 100.0), [], []
    for target, position in zip(targets, positions, strict=True):
        bias = float(np.interp(target, BINS, VALUES)) * supply / 100.0 if biased else 0.0
        volts, memory = tick(gains, ecu, memory, target * TRAVEL / 100.0, position * TRAVEL / 100.0, bias)
        ours.append(100.0 * float(volts) / supply)
        theirs.append(firmware.update(target, position))
    return ours, theirs


@pytest.mark.parametrize("biased", [True, False])
@pytest.mark.parametrize(("supply", "seed"), [(12.0, 1), (14.2, 2)])
@pytest.mark.parametrize("name", CASES)
def test_it_puts_out_what_its_source_puts_out(name: str, supply: float, seed: int, biased: bool) -> None:
    case = CASES[name]
    biased = biased and case.make.bias is not None
    firmware = case.firmware(biased)
    ours, theirs = drive(case.make, firmware, supply, biased, seed)
    assert np.allclose(ours, theirs, rtol=0.0, atol=1e-9)
    # every limit was met
    assert max(np.abs(theirs)) == pytest.approx(case.duty)
    assert max(np.abs(firmware.asked)) > 100.0
    if case.integral is not None:
        assert max(np.abs(firmware.held)) == pytest.approx(case.integral)
    assert np.ptp(theirs) > 100.0


def test_another_controller_puts_out_something_else() -> None:
    """What a profile says matters: FOME's numbers in Arduino's controller, or with a filter, are off by far."""
    for other in (RUSEFI, GENERIC):
        ours, theirs = drive(other, PidV1(False), 12.0, False, 1)
        assert np.max(np.abs(np.array(ours) - theirs)) > 5.0


def test_an_ecu_differs_in_what_it_does_not_share() -> None:
    fixes = RUSEFI.fixes
    assert differences(Ecu(), fixes) == ("period", "filter", "duty", "integral")
    assert differences(Ecu()._replace(**fixes), fixes) == ()
    assert differences(Ecu(supply=14.0, delay=1e-3)._replace(**fixes)._replace(integral=0.2), fixes) == ("integral",)
    assert differences(Ecu()._replace(**fixes)._replace(slew=50.0), fixes) == ("slew",)


def test_rusefis_gains_are_in_percent_and_of_continuous_time() -> None:
    assert RUSEFI.notation == FOME.notation == Notation("%", "%", "seconds")
