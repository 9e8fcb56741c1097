"""A channel that does not read zero where it must: current and speed before the first volt, EMF before the release.

offset = mean(y),   standard error sigma / sqrt n,   over the first stretch in which nothing happens yet

A voltage below its own noise is none that can be seen, and it drives a current all the same: a ramp that begins with
the record. So of a current, mean(v)/R is what the voltage explains, and the error of mean(v)/R is part of its error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import erfc
from typing import ClassVar

import numpy as np

from ...ranges import real, whole
from .. import TEST_BY_NAME
from ..base import Channel, Measurement
from ..finding import Finding
from ..signals import drive_voltage
from .base import AbstractDetector, Records
from .circuit import Value


@dataclass(frozen=True)
class ChannelOffset(AbstractDetector):
    """See the module.

    Args:
        errors: standard errors of the mean.
        noises: of one sample, the least offset.
        steps: of the logger's resolution, the least offset.
        fewest: samples of the stretch.
        quiet: noises within which the voltage counts as none, and the EMF as resting.
        creeps: standard errors by which current or speed of a motor alone may differ from 0 for the other to be judged.
        share: of the traces of a test that must show it.
    """

    errors: float = real(8.0, 0.0)
    noises: float = real(0.7, 0.0)
    steps: float = real(0.75, 0.0)
    fewest: int = whole(12, 1)
    quiet: float = real(6.0, 0.0)
    creeps: float = real(4.0, 0.0)
    share: float = real(0.8, 0.0, 1.0)
    kind: ClassVar[str] = "channel_offset"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        off: dict[str, dict[str, tuple[Value, Channel]]] = {name: {} for name in ("current", "emf", "motor_speed")}
        for test, traces in records.tests.items():
            for name in off:
                if (value := self._of_test(traces, name, records)) is not None:
                    off[name][test] = value
        for name, tests in off.items():
            if len(tests) > 1 and self._alike([value for value, _ in tests.values()]):
                yield self._finding(None, name, *_pooled(list(tests.values())))
            else:
                yield from (self._finding(test, name, *value) for test, value in tests.items())

    def _of_test(self, traces: tuple[Measurement, ...], name: str, records: Records) -> tuple[Value, Channel] | None:
        """Mean offset of all traces of a test, SI, where most of them show it."""
        read = {t.file: value for t in traces if (value := self._zero(t, name, records)) is not None}
        off = [v for file, v in read.items() if self._is_off(v, _channel(traces, file, name))]
        if not off or len(off) < self.share * len(read) or len({np.sign(v.value) for v in off}) > 1:
            return None
        return _mean(off), _channel(traces, next(iter(read)), name)

    def _alike(self, values: list[Value]) -> bool:
        """All of one sign and within a factor of two: one sensor."""
        sizes = [value.value for value in values]
        return min(sizes) * max(sizes) > 0.0 and max(map(abs, sizes)) < 2.0 * min(map(abs, sizes))

    def _zero(self, trace: Measurement, name: str, records: Records) -> Value | None:
        """Mean of the channel where it must be zero, SI; None where no such stretch was logged."""
        channel, boundary = trace.channels.get(name), TEST_BY_NAME[trace.test].boundary
        if channel is None or (boundary.terminals_open and name != "emf") or (name == "motor_speed" and
                                                                               not boundary.gear_apart):  # fmt: skip
            return None
        marker = channel if boundary.terminals_open else drive_voltage(trace, records.config)
        if marker is None:
            return None
        level = float(np.median(marker.value[: self.fewest])) if boundary.terminals_open else 0.0
        inside = channel.value[channel.time < self._departs(marker, level)]
        inside = inside[: int(0.9 * inside.size)]  # what the stretch's end may have seen of the event
        if inside.size < self.fewest or self._moves(inside, channel):
            return None
        other = trace.channels.get("current" if name == "motor_speed" else "motor_speed")
        if other is not None and self._lives(other.value[: inside.size], other):
            return None
        found = Value(float(np.mean(inside)), self._error(channel) / np.sqrt(inside.size))
        return found if name != "current" else self._beyond(found, marker, inside.size, _ohms(trace, records))

    def _beyond(self, current: Value, volts: Channel, samples: int, ohms: float | None) -> Value | None:
        """The part of a mean current that the voltage of these samples does not explain; None where it may explain any,
        for nobody knows the resistance."""
        mean, error = float(np.mean(volts.value[:samples])), self._error(volts) / np.sqrt(samples)
        if ohms is None:
            return current if abs(mean) < self.creeps * error else None
        error = np.hypot(error, volts.quantum / np.sqrt(12.0))
        return Value(current.value - mean / ohms, float(np.hypot(current.error, error / ohms)))

    def _departs(self, marker: Channel, level: float) -> float:
        """When a channel leaves a level, s."""
        away = np.abs(marker.value - level) > self.quiet * max(marker.sigma, marker.quantum)
        return float(marker.time[np.argmax(away)]) if away.any() else float("-inf")

    def _moves(self, value: np.ndarray, channel: Channel) -> bool:
        """The second half differs from the first: a plate that falls already, a coil that discharges still."""
        half = value.size // 2
        change = float(np.mean(value[half:]) - np.mean(value[:half]))
        return abs(change) > 4.0 * self._error(channel) / np.sqrt(half)

    def _lives(self, value: np.ndarray, channel: Channel) -> bool:
        """Not zero either: a motor alone that creeps into a slot, and sends a current."""
        return abs(float(np.mean(value))) > self.creeps * self._error(channel) / np.sqrt(max(value.size, 1))

    def _error(self, channel: Channel) -> float:
        return max(channel.sigma, channel.quantum / np.sqrt(12.0))

    def _is_off(self, value: Value, channel: Channel) -> bool:
        least = max(self.errors * value.error, self.noises * channel.sigma, self.steps * channel.quantum)
        return abs(value.value) > least

    def _finding(self, test: str | None, name: str, offset: Value, channel: Channel) -> Finding:
        mean, error = offset
        size, unit = mean / abs(channel.scale), channel.unit
        before = "the plate is let go" if name == "emf" else "a voltage is there"
        otherwise = ', or take [model] effects = ["current_sensor_offset"] in rig.toml' if name == "current" else ""
        mend = f"Subtract {size:.4g} from the column '{channel.header}'{' there' if test else ''}{otherwise}."
        return Finding(self.kind, size, unit, float(erfc(abs(mean) / error / 2**0.5)),
                       f"In {test or 'every test'} '{channel.header}' reads {size:.4g} {unit} before {before} "
                       f"({abs(mean) / error:.0f} standard errors), where it must read 0.", mend, test,
                       channel=name)  # fmt: skip


def _ohms(trace: Measurement, records: Records) -> float | None:
    """Resistance of the trace's circuit, else of any; None where none shows."""
    own = [records.circuits.get(trace.test), *records.circuits.values()]
    return next((c.R.value for c in own if c is not None and c.R is not None and c.R.value > 0.0), None)


def _mean(values: list[Value]) -> Value:
    """Weighted by their errors."""
    error = float(1.0 / np.sqrt(sum(1.0 / v.error**2 for v in values)))
    return Value(error**2 * sum(v.value / v.error**2 for v in values), error)


def _pooled(tests: list[tuple[Value, Channel]]) -> tuple[Value, Channel]:
    return _mean([value for value, _ in tests]), tests[0][1]


def _channel(traces: tuple[Measurement, ...], file: str, name: str) -> Channel:
    return next(t.channels[name] for t in traces if t.file == file)
