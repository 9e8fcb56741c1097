"""A voltage channel that samples the PWM itself: nothing or all of the supply, while the current does not follow.

    R^2 of the voltage in   i_(k+1) - i_k = a + b i_k + sum_j c_j v_(k+1-j),   j = 0 ... 4

A voltage that really jumps so drives the current up and down with it. One sampled out of a PWM that is far faster jumps
at random, or in a slow beat of the two frequencies, and neither the current's steps nor the circuit's equation, v = R i
+ L di/dt + k w over windows of some samples, have to do with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real, whole
from ..base import Channel, Measurement, RigConfig
from ..finding import Finding
from ..signals import on_times
from .base import AbstractDetector, Records, everywhere, in_files
from .circuit import left_by, values_of, windows_of

LAGS = 4  # samples by which the current may be late


@dataclass(frozen=True)
class SwitchedVoltage(AbstractDetector):
    """See the module.

    Args:
        fewest: samples of a trace.
        within: of the highest level, how near to a level a sample must lie.
        noises: by which the levels must be apart.
        on: share of the samples that must lie on a level.
        jumps: from one level to the other, at least.
        follows: share of the current's steps that the voltage explains, at most.
        misses: share of the voltage that the circuit's equation must leave in half of the windows.
    """

    fewest: int = whole(40, 20)
    within: float = real(0.06, 0.0, 0.5)
    noises: float = real(50.0, 1.0)
    on: float = real(0.97, 0.0, 1.0)
    jumps: int = whole(8, 1)
    follows: float = real(0.1, 0.0, 1.0)
    misses: float = real(0.025, 0.0, 1.0)
    kind: ClassVar[str] = "switched_voltage"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            found = {t.file: jumps for t in traces if (jumps := self._jumps(t, records.config)) is not None}
            if found:
                yield self._finding(test, found, traces)

    def _jumps(self, trace: Measurement, config: RigConfig) -> int | None:
        """Jumps between the levels, where the voltage is that of a PWM; else None."""
        voltage, current = trace.channels.get("voltage"), trace.channels.get("current")
        if voltage is None or current is None or voltage.value.size < self.fewest:
            return None
        size = np.abs(voltage.value)
        level = float(np.median(size[size > 0.5 * np.max(size)]))
        high, low = (np.abs(size - at) < self.within * level for at in (level, 0.0))
        if level < self.noises * voltage.sigma or np.mean(high | low) < self.on:
            return None
        levels = high[high | low]
        jumps = int(np.sum(levels[1:] != levels[:-1]))
        if jumps < self.jumps or _explained(voltage, current) > self.follows:
            return None
        return jumps if _missed(trace, config) > self.misses * level else None

    def _finding(self, test: str, found: dict[str, int], traces: tuple[Measurement, ...]) -> Finding:
        trace = next(t for t in traces if t.file in found)
        channel, jumps = trace.channels["voltage"], sum(found.values())
        highest = np.max(np.abs(channel.logged(channel.value)))
        where = in_files(test, list(found), traces)
        return Finding(
            self.kind, jumps, "jumps", 0.0,
            f"{where[0].upper()}{where[1:]} '{channel.header}' shows the switching of a PWM, sampled now and then: it "
            f"is nothing or {highest:.3g} {channel.unit}, jumps {jumps} times, and the current does not follow.",
            "Log the duty and the supply instead ('duty [%]', and 'supply [V]' or [rig] supply_V in rig.toml), or the "
            "voltage behind a filter that is far slower than the PWM and far faster than the motor.",
            test, everywhere(list(found), traces), "voltage", sure=True,
        )  # fmt: skip


def _explained(voltage: Channel, current: Channel) -> float:
    """Share of the steps of the current, beyond what it does by itself, that the voltage about them explains."""
    i, v = current.value, on_times(voltage, current.time)
    last = np.column_stack([np.ones(i.size - 1), i[:-1]])[LAGS - 1 :]
    volts = np.column_stack([v[LAGS - j : v.size - j] for j in range(LAGS + 1)])
    steps = np.diff(i)[LAGS - 1 :]
    alone, besides = (_left(rows, steps) for rows in (last, np.column_stack([last, volts])))
    return 1.0 - besides / max(alone, 1e-300)


def _left(rows: np.ndarray, right: np.ndarray) -> float:
    """Sum of squares that a least-squares fit leaves."""
    return float(np.sum((right - rows @ np.linalg.lstsq(rows, right, rcond=None)[0]) ** 2))


def _missed(trace: Measurement, config: RigConfig) -> float:
    """What the circuit's equation leaves of the voltage in half of the windows, V; 0 where it cannot be written."""
    windows = windows_of(trace, config)
    values = values_of(windows) if windows is not None else None
    return 0.0 if windows is None or values is None else float(np.median(np.abs(left_by(values, windows))))
