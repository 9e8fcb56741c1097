"""Reads a measurement folder: rig tests, reader, units, the paper's graph readings; `checks/` finds mistakes of the rig
before any fit.

A new rig test is one class here and its name in `TESTS`.
"""

from __future__ import annotations

from .base import AbstractRigTest
from .driven import ClosedLoop, Drive, Response, Sine
from .electrical import BackEmf, Inductance, Resistance
from .mechanical import Inertia, StaticLoad, Viscous

# the registry of rig tests, in the order in which the readings build on each other
TESTS: tuple[AbstractRigTest, ...] = (
    *(test() for test in (Resistance, Inductance, BackEmf, Viscous, StaticLoad, Inertia)),
    *(test() for test in (Response, ClosedLoop, Sine, Drive)),
)
TEST_BY_NAME: dict[str, AbstractRigTest] = {test.name: test for test in TESTS}
