"""A time base that runs fast or slow in one rig test, where it can be told without a fit.

    logged = s x true time:  mains hum at f/s   or   back-EMF constant s k and duration of the fall s T, both alike

Two clocks: the mains, wherever it hums in a channel; and the same plate let go from open in two tests, whose EMF over
speed and whose fall are stretched by the same factor. A gain of the EMF would stretch only the first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log
from statistics import median
from typing import ClassVar

import numpy as np

from ...ranges import real
from .. import TEST_BY_NAME
from ..base import Measurement, RigConfig
from ..finding import Finding
from .base import AbstractDetector, Records, scaled_unit
from .hum import SILENT, Mains, mains_in


@dataclass(frozen=True)
class TimeScale(AbstractDetector):
    """See the module.

    Args:
        band: relative deviation of a clock that is searched for.
        chance: of the line that serves as a clock, at most.
        clear: chance of a line in one trace below which its frequency counts.
        grid: relative deviation of the mains itself.
        errors: standard errors.
        share: relative deviation of a fall, at least.
        alike: by which the two stretches may differ, relative to the larger, and at least `agree`.
        agree: absolute.
    """

    band: float = real(0.06, 0.0, 1.0)
    chance: float = real(1e-10, 0.0, 1.0)
    clear: float = real(1e-3, 0.0, 1.0)
    grid: float = real(0.006, 0.0, 1.0)
    errors: float = real(4.5, 0.0)
    share: float = real(0.012, 0.0, 1.0)
    alike: float = real(0.25, 0.0, 1.0)
    agree: float = real(0.006, 0.0, 1.0)
    kind: ClassVar[str] = "time_scale"

    def find(self, records: Records) -> Iterator[Finding]:
        hummed = [f for test, traces in records.tests.items() for f in self._by_mains(test, traces, records)]
        yield from hummed
        yield from (f for f in self._by_falls(records) if f.test not in [h.test for h in hummed])

    def _by_mains(self, test: str, traces: tuple[Measurement, ...], records: Records) -> Iterator[Finding]:
        names = dict.fromkeys(n for t in traces for n in t.channels if n not in SILENT)
        clocks = [m for name in names if (m := mains_in(records, test, name, self.band)) and m.clear(self.chance)]
        clock = min(clocks, key=lambda m: m.error, default=None)
        if clock is not None and self._off(clock):
            s = clock.nominal / clock.frequency
            yield self._finding(test, traces, s, clock.chance,
                                f"its mains hums at {clock.frequency:.4g} Hz instead of {clock.nominal:g}")  # fmt: skip

    def _off(self, m: Mains) -> bool:
        off = abs(m.frequency / m.nominal - 1.0)
        clear = [line.frequency for line in m.lines if line.chance < self.clear]
        together = max(clear) - min(clear) if len(clear) > 1 else np.inf
        return off > self.grid + self.errors * m.error / m.nominal and together < 0.5 * off * m.nominal

    def _by_falls(self, records: Records) -> Iterator[Finding]:
        read: dict[str, tuple[float, float, float, float]] = {}
        for test, traces in records.tests.items():
            circuit = records.circuits.get(test)
            if not TEST_BY_NAME[test].boundary.released or circuit is None or circuit.k is None:
                continue
            falls = [fall for t in traces if (fall := fall_time(t, records.config)) is not None]
            if falls and circuit.k.value > 0.0:
                spread = (max(falls) - min(falls)) / (len(falls) ** 0.5 * median(falls))
                read[test] = circuit.k.value, circuit.k.error, median(falls), spread
        if len(read) != 2:
            return
        (one, a), (other, b) = read.items()
        stretch, fall = log(a[0] / b[0]), log(a[2] / b[2])
        error = np.hypot(np.hypot(a[1] / a[0], b[1] / b[0]), np.hypot(a[3], b[3]))
        both = abs(stretch - fall) < max(self.alike * max(abs(stretch), abs(fall)), self.agree)
        if (
            stretch * fall <= 0.0
            or min(abs(stretch), abs(fall)) < max(self.share, self.errors * error / 2**0.5)
            or not both
        ):
            return
        s = float(np.exp(0.5 * (stretch + fall)))
        test, s = self._odd_one(records, one, other, s)
        against = other if test == one else one
        yield self._finding(test, records.tests[test], s, 0.0,
                            f"the plate falls in {s:.4g} of the time that it takes in {against}, and its EMF over "
                            "speed is as much off")  # fmt: skip

    def _odd_one(self, records: Records, one: str, other: str, s: float) -> tuple[str, float]:
        """Which of two it is: the one whose back-EMF constant is farther from that of the other tests."""
        ratio = records.config.gear_ratio
        rest = [(t, c.k.value) for t, c in records.circuits.items() if t not in (one, other) and c.k]
        others = [log(k * (ratio if TEST_BY_NAME[t].boundary.gear_apart else 1.0)) for t, k in rest if k > 0.0]
        if not others:
            return other, 1.0 / s
        known = float(np.exp(median(others)))
        off = {t: abs(log(k.value / known)) for t in (one, other) if (k := records.circuits[t].k) and k.value > 0.0}
        return (one, s) if off[one] > off[other] else (other, 1.0 / s)

    def _finding(self, test: str, traces: tuple[Measurement, ...], s: float, chance: float, words: str) -> Finding:
        way = "fast" if s > 1.0 else "slow"
        return Finding(self.kind, s, "", chance,
                       f"The clock of {test} runs {100.0 * abs(s - 1.0):.3g} % {way}: {words}.",
                       f"Head its time column 'time [{scaled_unit('s', 1.0 / s)}]' if it is in s now, or correct the "
                       "sample rate that the logger was given.", test, channel="time")  # fmt: skip


def fall_time(trace: Measurement, config: RigConfig, first: float = 0.8, last: float = 0.2) -> float | None:
    """How long a released plate takes from 80 to 20 % of its stroke, s; None where it was not logged."""
    position = trace.channels.get("position")
    if position is None:
        return None
    high, low = float(np.quantile(position.value, 0.98)), float(np.quantile(position.value, 0.02))
    levels = [low + part * (high - low) for part in (first, last)]
    times = [_crossing(position.time, position.value, level, 6.0 * position.sigma) for level in levels]
    return times[1] - times[0] if times[0] is not None and times[1] is not None and times[1] > times[0] else None


def _crossing(time: np.ndarray, value: np.ndarray, level: float, about: float) -> float | None:
    """When a fall crosses a level: a line through the samples that lie near it."""
    below = value < level
    if not below.any() or below[0]:
        return None
    k = int(np.argmax(below))
    near = slice(max(0, k - 4), k + 4)
    t, y = time[near] - time[k], value[near]
    slope, offset = np.polyfit(t, y, 1)
    return float(time[k] + (level - offset) / slope) if slope < 0.0 else None
