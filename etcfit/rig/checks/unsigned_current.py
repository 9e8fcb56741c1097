"""A current without its sign: never below zero while the voltage drives both ways. See `other_current.py`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real, whole
from ..base import Channel
from ..finding import Finding
from .base import AbstractDetector, Records


@dataclass(frozen=True)
class UnsignedCurrent(AbstractDetector):
    """See the module.

    Args:
        times: how many times less it must leave of the voltage with a sign, in windows in which that sign is negative.
        fewest: such windows.
        below: noises by which a current of one sign may lie below zero.
    """

    times: float = real(4.0, 1.0)
    fewest: int = whole(6, 1)
    below: float = real(6.0, 0.0)
    kind: ClassVar[str] = "unsigned_current"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        for test, current in records.currents.items():
            channels = [t.channels["current"] for t in records.tests[test] if "current" in t.channels]
            rows = current.sign < 0.0
            if rows.sum() < self.fewest or not all(self._one_sign(c) for c in channels):
                continue
            found = current.better(current.unsigned, 0.5, rows)
            if found is not None and found[0] > self.times:
                yield self._finding(test, channels[0], found[0], int(rows.sum()), rows.size)

    def _one_sign(self, channel: Channel) -> bool:
        return float(np.min(channel.value)) >= -self.below * max(channel.sigma, channel.quantum)

    def _finding(self, test: str, channel: Channel, times: float, rows: int, windows: int) -> Finding:
        return Finding(
            self.kind, rows / windows, "", 0.0,
            f"In {test} '{channel.header}' has lost its sign: it is never below zero, though the voltage drives the "
            f"motor backwards in {rows} of {windows} stretches; with the sign of the voltage less the EMF it leaves "
            f"{times:.0f} times less of the voltage unexplained there.",
            "Log the current with a sensor that shows its sign; until then map the column to \"ignore\" under "
            "[columns], or empty its cells where the current flows backwards.", test, channel="current", sure=True,
        )  # fmt: skip
