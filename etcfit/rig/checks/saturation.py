"""A channel whose samples pile up on one extreme value while it is lively everywhere else: an ADC at its rail.

What the physics explains is left alone: an angle at an end stop, a voltage or duty at what the supply can give.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real, whole
from ..base import Channel, Measurement, RigConfig
from ..finding import Finding
from .base import AbstractDetector, Records, everywhere, in_files

COMMANDED = ("setpoint", "duty")  # what is asked for rests wherever it likes


@dataclass(frozen=True)
class Saturation(AbstractDetector):
    """See the module.

    Args:
        run: equal samples in a row at the extreme, at least; and
        share: of the trace, at least so long. Or, over all traces of a test,
        pile: samples on one extreme value, at least; and
        over: times as many as on each of the next `levels` steps below.
        levels: see `over`.
        repeats: share of equal neighbours elsewhere, at most: a livelier channel does not rest on one value by chance.
        at_limit: of the supply, or of the travel, within which the physics explains a rest.
    """

    run: int = whole(4, 1)
    share: float = real(0.005, 0.0, 1.0)
    pile: int = whole(4, 1)
    over: float = real(8.0, 0.0)
    levels: int = whole(10, 1)
    repeats: float = real(0.25, 0.0, 1.0)
    at_limit: float = real(0.03, 0.0, 1.0)
    kind: ClassVar[str] = "saturation"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            for name in dict.fromkeys(n for t in traces for n in t.channels if n not in COMMANDED):
                channels = {t.file: t.channels[name] for t in traces if name in t.channels}
                for side in (1.0, -1.0):
                    rail = side * max(float(np.max(side * c.value)) for c in channels.values())
                    rests = {file: n for file, c in channels.items() if (n := self._on(c, rail))}
                    if not self._explained(name, rail, records.config) and self._piled(channels, rests, rail, side):
                        yield self._finding(test, name, channels, rests, rail, traces)

    def _on(self, channel: Channel, rail: float) -> int:
        """Samples on the rail, SI; 0 where the channel rests elsewhere too: a staircase, or steps without noise."""
        on = channel.value == rail
        same = np.diff(channel.value) == 0.0
        elsewhere = ~on[1:]
        lively = elsewhere.sum() >= 4 * self.run and same[elsewhere].mean() <= self.repeats
        return int(on.sum()) if lively else 0

    def _piled(self, channels: Mapping[str, Channel], rests: Mapping[str, int], rail: float, side: float) -> bool:
        """In long runs in one trace, or far more often in all than on the steps below."""
        for file in rests:
            value = channels[file].value
            if clipped(value, rail, max(self.run, round(self.share * value.size))):
                return True
        step = max(c.quantum for c in channels.values()) or max(c.sigma for c in channels.values())
        below = side * (rail - np.concatenate([channels[file].value for file in rests])) if rests else np.empty(0)
        near = int(np.sum((below > 0.5 * step) & (below < (self.levels + 0.5) * step)))
        count = sum(rests.values())
        return count >= self.pile and count > self.over * max(near / self.levels, 0.5)

    def _explained(self, name: str, value: float, config: RigConfig) -> bool:
        if name in ("position", "setpoint"):
            low, high = config.travel
            reach = self.at_limit * (high - low) if np.isfinite(high - low) else 0.0
            return value < low + reach or value > high - reach
        return (
            name == "voltage" and config.supply_V is not None and abs(value) > (1.0 - self.at_limit) * config.supply_V
        )

    def _finding(
        self,
        test: str,
        name: str,
        channels: Mapping[str, Channel],
        rests: Mapping[str, int],
        rail: float,
        traces: tuple[Measurement, ...],
    ) -> Finding:
        channel, count = channels[next(iter(rests))], sum(rests.values())
        where = in_files(test, list(rests), traces)
        return Finding(self.kind, count, "samples", 0.0,
                       f"{where[0].upper()}{where[1:]} '{channel.header}' rests on "
                       f"{float(channel.logged(np.array(rail))):.6g} {channel.unit} for {count} samples: saturated.",
                       "Log again with a wider range, or empty those cells.", test,
                       everywhere(list(rests), traces), name)  # fmt: skip


def clipped(value: np.ndarray, rail: float, least: int) -> int:
    """Samples in runs of `least` or more on the rail."""
    on = value == rail
    same = np.concatenate(([False], np.diff(value) == 0.0))
    return sum(run for run in _runs(on & same) if run >= least)


def _runs(flags: np.ndarray) -> list[int]:
    """Lengths of the stretches of True, the sample each begins at counted in."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return [int(stop - start) + 1 for start, stop in zip(edges[::2], edges[1::2], strict=True)]
