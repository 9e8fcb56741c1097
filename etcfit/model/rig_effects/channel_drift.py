"""A drive whose zero wanders away from what was commanded, in one test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


class ChannelDrift(AbstractRigEffect):
    """logged = true + r t, t since the trace began: what acted was logged - r t, in the traces of one test.

    For a torque that was commanded and not measured: the zero of the amplifier that makes it moves as it warms, and a
    plant without a spring integrates that. A constant zero is the preload T_PL.

    Source: GUM (JCGM 100:2008), F.1.1.3: a drift as a systematic error that changes with time. Differs from source:
    the same rate in every trace of the test.
    """

    kind = "channel_drift"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = ("torque",)
    told_by = "a long log of that test with the command at zero"
    off: ClassVar[Mapping[str, float] | None] = {"drift": 0.0}
    drift: Scalar = parameter("N*m/s", Real(0.01), 0.0, "rate at which a zero wanders", "JCGM 100:2008, F.1.1.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """The torque of each test that it drove: a voltage is measured at the terminals, drift and all."""
        return tuple(Place(test, "torque") for test, found in logged.items() if "torque" in found)

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        rate = self.here(test_of, steps.trace) * self.drift
        before, after = rate * (steps.time - steps.dt), rate * steps.time
        return steps._replace(torque0=steps.torque0 - before, torque1=steps.torque1 - after)
