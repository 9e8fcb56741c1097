"""rusEFI's throttle controller, put down here in its own units from its source, against ours given its limits."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from etcfit.control.pid import Gains
from etcfit.control.pid.ecu import Memory, tick
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.ecus import RUSEFI, differences

TRAVEL = np.pi / 2
BINS, VALUES = [0.0, 9.7, 10.3, 100.0], [-20.0, -15.0, 15.0, 30.0]


@dataclass
class Rusefi:
    """electronic_throttle.cpp and efi_pid.cpp: 500 Hz, everything in %."""

    p: float
    i: float
    d: float
    biased: bool = True
    i_term: float = 0.0
    previous: float = 0.0
    asked: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        error = target - position
        self.i_term = min(max(self.i_term + self.i * 0.002 * error, -30.0), 30.0)
        d_term = self.d / 0.002 * (error - self.previous)
        self.previous = error
        closed = min(max(self.p * error + self.i_term + d_term, -100.0), 100.0)
        self.asked.append(closed)
        opened = float(np.interp(target, BINS, VALUES)) if self.biased else 0.0
        return 100.0 * min(max(0.01 * (opened + closed), -0.9), 0.9)


@pytest.mark.parametrize("biased", [True, False])
@pytest.mark.parametrize("supply", [12.0, 14.2])
def test_it_puts_out_what_rusefis_source_puts_out(biased: bool, supply: float) -> None:
    his = Rusefi(8.0, 120.0, 0.08, biased)
    ecu = Ecu(supply=supply)._replace(**RUSEFI)
    unit = Notation("%", "%").units(ecu, TRAVEL)
    gains = Gains(his.p * unit.P, his.i * unit.I, his.d * unit.D)
    rng = np.random.default_rng(1)
    targets = np.repeat(rng.uniform(0.0, 100.0, 12), 60)
    positions = np.clip(targets + 20.0 * np.cumsum(rng.standard_normal(targets.size)) / 30.0, 0.0, 100.0)
    memory, ours, theirs = Memory.at_rest(gains, ecu, 0.0), [], []
    for target, position in zip(targets, positions, strict=True):
        bias = float(np.interp(target, BINS, VALUES)) * supply / 100.0 if biased else 0.0
        volts, memory = tick(gains, ecu, memory, target * TRAVEL / 100.0, position * TRAVEL / 100.0, bias)
        ours.append(100.0 * float(volts) / supply)
        theirs.append(his.update(target, position))
    assert np.allclose(ours, theirs, atol=1e-9)
    # every limit was met
    assert abs(his.i_term) == 30.0
    assert max(theirs) == 90.0
    assert max(his.asked) == 100.0
    assert np.ptp(theirs) > 100.0


def test_an_ecu_differs_in_what_it_does_not_share() -> None:
    assert differences(Ecu(), RUSEFI) == ("period", "filter", "duty", "integral")
    assert differences(Ecu()._replace(**RUSEFI), RUSEFI) == ()
    assert differences(Ecu(supply=14.0, delay=1e-3)._replace(**RUSEFI)._replace(integral=0.2), RUSEFI) == ("integral",)
