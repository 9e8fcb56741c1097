"""Throttle controllers whose source is public, put down in plain Python from that source, against our tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from etcfit.control.pid import Gains
from etcfit.control.pid.ecu import Memory, tick
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.ecus import ARDUINO, FOME, GENERIC, RUSEFI, EcuProfile, differences
from firmwares import Firmware, Fome, PidV1, Rusefi, Settings, Textbook

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
