"""A measurement folder as it is read: rig tests, reader, units, the paper's graph readings; `checks/` finds mistakes
of the rig before any fit.

A new rig test is one file here and its name in `TESTS`.
"""

from __future__ import annotations

from .back_emf import BackEmf
from .base import AbstractRigTest
from .closed_loop import ClosedLoop
from .drive import Drive
from .inductance import Inductance
from .inertia import Inertia
from .resistance import Resistance
from .response import Response
from .sine import Sine
from .static_load import StaticLoad
from .viscous import Viscous

# the one registration; in the order in which the readings build on each other
TESTS: tuple[AbstractRigTest, ...] = tuple(
    test()
    for test in (
        Resistance,
        Inductance,
        BackEmf,
        Viscous,
        StaticLoad,
        Inertia,
        Response,
        ClosedLoop,
        Sine,
        Drive,
    )
)
TEST_BY_NAME: dict[str, AbstractRigTest] = {test.name: test for test in TESTS}
