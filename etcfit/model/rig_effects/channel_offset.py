"""A channel whose zero is off, in one test or in one trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from ..parameters import Parameter, Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place
from .channel_gain import shared
from .one_trace import channels_of_traces

# of each channel that may have one: SI unit and a usual size
_USUAL = {"current": ("A", 0.05), "position": ("rad", 0.02), "voltage": ("V", 0.1), "emf": ("V", 0.05),
          "motor_speed": ("rad/s", 2.0)}  # fmt: skip


class ChannelOffset(AbstractRigEffect):
    """logged = true + d, in the traces of one test, or in one of them; of the terminal voltage, what was applied is
    logged - d.

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a zero. Differs from source: one test, or one
    trace, alone has it.
    """

    kind = "channel_offset"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = (*_USUAL,)
    told_by = "a log of that test with nothing connected"
    off: ClassVar[Mapping[str, float] | None] = {"offset": 0.0}
    # the size is in the unit of the log; what is read is linear in an offset, so that any start leads to it
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"channel_offset": lambda size: 0.0}
    offset: Scalar = parameter("", Real(1.0), 0.0, "zero of a channel", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel of each test, where another test logged it too."""
        return tuple(Place(test, channel) for test, channel in shared(logged) if channel in _USUAL)

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel that may have one."""
        return channels_of_traces(logged, tuple(_USUAL), cls.places)

    @classmethod
    def named(cls, p: Parameter) -> Parameter:
        unit, size = _USUAL.get(cls.place.channel, (p.unit, 1.0))
        return replace(super().named(p), unit=unit, domain=Real(size))

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        shift = self.here(test_of, steps.trace) * self.offset
        if self.place.channel == "voltage":
            shift = shift * steps.circuit
            return steps._replace(voltage0=steps.voltage0 - shift, voltage1=steps.voltage1 - shift)
        if self.place.channel == "position":
            return steps._replace(target0=steps.target0 - shift, target1=steps.target1 - shift)
        return steps

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        shift = self.here(test_of, trace) * self.offset * resets.begins
        return resets._replace(theta=resets.theta - shift) if self.place.channel == "position" else resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        channel = self.place.channel
        return seen | {channel: seen[channel] + self.here(test_of, trace) * self.offset} if channel in seen else seen
