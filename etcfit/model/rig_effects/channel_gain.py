"""A channel that reads too much or too little, in one test or in one trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import DRIVING, OBSERVED, AbstractRigEffect, Logged, Place
from .one_trace import channels_of_traces

_SIGN = 0.3  # a gain that near to -2, which is a factor of -1, is a sign
_UNIT = 8.0  # a factor above this, or below its inverse, is a unit


class ChannelGain(AbstractRigEffect):
    """logged = (1 + g) true, in the traces of one test, or in one of them; of the terminal voltage, what was
    applied is logged / (1 + g).

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a scale. Differs from source: one test, or one trace, alone
    has it.
    """

    kind = "channel_gain"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = (*OBSERVED, *DRIVING)
    told_by = "both tests logged with the same probe, one after the other"
    off: ClassVar[Mapping[str, float] | None] = {"gain": 0.0}
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"unit_scale": lambda factor: factor - 1.0}
    gain: Scalar = parameter("", Real(0.02), 0.0, "relative error of a channel's scale", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel of each test, where another test logged it too."""
        return tuple(Place(test, channel) for test, channel in shared(logged))

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel but a torque, which nobody measures."""
        return channels_of_traces(logged, (*OBSERVED, "voltage"), cls.places)

    @classmethod
    def called(cls, value: float) -> str:
        factor = 1.0 + value
        if abs(factor + 1.0) < _SIGN:
            return "channel_sign"
        return cls.kind if 1.0 / _UNIT < abs(factor) < _UNIT else "unit_scale"

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        factor = 1.0 + self.here(test_of, steps.trace) * self.gain
        if self.place.channel == "voltage":
            return steps._replace(voltage0=steps.voltage0 / factor, voltage1=steps.voltage1 / factor)
        if self.place.channel == "torque":
            return steps._replace(torque0=steps.torque0 / factor, torque1=steps.torque1 / factor)
        if self.place.channel == "position":  # the guide follows the true angle
            return steps._replace(target0=steps.target0 / factor, target1=steps.target1 / factor)
        return steps

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        factor = 1.0 + self.here(test_of, trace) * self.gain
        return resets._replace(theta=resets.theta / factor) if self.place.channel == "position" else resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        channel = self.place.channel
        if channel not in seen:
            return seen
        return seen | {channel: (1.0 + self.here(test_of, trace) * self.gain) * seen[channel]}


def shared(logged: Logged) -> list[tuple[str, str]]:
    """(test, channel) of every channel that more than one test logged, in a fixed order."""
    channels = sorted(set().union(*logged.values()) - {"supply", "setpoint", "duty", "torque", "temperature"})
    tests = {channel: [test for test, found in logged.items() if channel in found] for channel in channels}
    return [(test, channel) for channel, found in tests.items() if len(found) > 1 for test in found]
