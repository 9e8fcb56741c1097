"""Errors of one channel's readings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from ..parameters import Parameter, Real, Scalar, parameter
from .base import DRIVING, OBSERVED, AbstractRigEffect, Logged, Place, channels_of_traces

_SIGN = 0.3  # a gain so near to -2, which is a factor of -1, is a wrong sign
_UNIT = 8.0  # a factor above this, or below its inverse, is a wrong unit


# A channel that reads too much or too little, in one test or in one trace
class ChannelGain(AbstractRigEffect):
    """logged = (1 + g) true, in the traces of one test, or in one of them; the applied terminal voltage is
    logged / (1 + g).

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a scale. Differs from source: only one test, or one trace,
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
        """Each channel of each test, if another test logged it too."""
        return tuple(Place(test, channel) for test, channel in shared(logged))

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel except a torque, which is not measured."""
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


# SI unit and usual size of the offset, by channel
_USUAL = {"current": ("A", 0.05), "position": ("rad", 0.02), "voltage": ("V", 0.1), "emf": ("V", 0.05),
          "motor_speed": ("rad/s", 2.0)}  # fmt: skip


# A channel whose zero is off, in one test or in one trace
class ChannelOffset(AbstractRigEffect):
    """logged = true + d, in the traces of one test, or in one of them; the applied terminal voltage is logged - d.

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a zero. Differs from source: only one test, or one trace,
        has
    it.
    """

    kind = "channel_offset"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = (*_USUAL,)
    told_by = "a log of that test with nothing connected"
    off: ClassVar[Mapping[str, float] | None] = {"offset": 0.0}
    # the size is in the unit of the log; the reading is linear in an offset, so any start leads to it
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"channel_offset": lambda size: 0.0}
    offset: Scalar = parameter("", Real(1.0), 0.0, "zero of a channel", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel of each test, if another test logged it too."""
        return tuple(Place(test, channel) for test, channel in shared(logged) if channel in _USUAL)

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel that may have an offset."""
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


# A drive whose zero wanders away from what was commanded, in one test
class ChannelDrift(AbstractRigEffect):
    """logged = true + r t, t since the trace began: the true input was logged - r t, in the traces of one test.

    It applies to a torque that was commanded and not measured: the zero of the amplifier moves as it warms, and a
    plant without a spring integrates this error. A constant zero is the preload T_PL.

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
        """The torque of each test with a torque as input; a voltage is measured at the terminals, including any
        drift."""
        return tuple(Place(test, "torque") for test, found in logged.items() if "torque" in found)

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        rate = self.here(test_of, steps.trace) * self.drift
        before, after = rate * (steps.time - steps.dt), rate * steps.time
        return steps._replace(torque0=steps.torque0 - before, torque1=steps.torque1 - after)
