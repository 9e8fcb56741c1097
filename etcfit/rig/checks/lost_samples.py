"""Samples that an even clock lost: intervals of two, three ... periods among many of one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real
from ..finding import Finding
from .base import AbstractDetector, Records, everywhere, in_files


@dataclass(frozen=True)
class LostSamples(AbstractDetector):
    """See the module.

    Args:
        even: share of the intervals that must be one period; else the logger has no clock of its own.
        near: periods, what counts as a whole number of them.
        share: of the samples, the least that are lost.
    """

    even: float = real(0.9, 0.0, 1.0)
    near: float = real(0.2, 0.0, 1.0)
    share: float = real(1e-4, 0.0, 1.0)
    kind: ClassVar[str] = "lost_samples"

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            lost = {t.file: count for t in traces if (count := self.lost(t.time)) > self.share * t.time.size}
            if lost:
                where = in_files(test, list(lost), traces)
                yield Finding(self.kind, sum(lost.values()), "samples", 0.0,
                              f"{where[0].upper()}{where[1:]} an even clock has lost {sum(lost.values())} samples.",
                              "Nothing need be mended, for time is read as it is logged; look whether the logger wrote "
                              "its rows too late.", test, everywhere(list(lost), traces), "time")  # fmt: skip

    def lost(self, time: np.ndarray) -> int:
        """How many samples are missing on an even clock; time in s, shape (n,), n >= 2."""
        periods = np.diff(time) / np.median(np.diff(time))
        whole = np.round(periods)
        if np.mean(np.abs(periods - 1.0) < self.near) < self.even:
            return 0
        return int(np.sum((whole - 1.0)[(whole > 1.0) & (np.abs(periods - whole) < self.near)]))
