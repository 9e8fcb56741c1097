"""A log from the car: position and setpoint, each on its own time base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

_GAP = 0.5  # s: a shorter step may be a logger that has slowed down


@dataclass(frozen=True, eq=False)
class Series:
    """One quantity."""

    time: np.ndarray  # s, shape (n,), strictly rising; a logger may record each quantity at a different rate
    value: np.ndarray  # per cent of travel, shape (n,)

    @classmethod
    def rising(cls, time: np.ndarray, value: np.ndarray) -> Series:
        """The samples at which both were logged and time increases: an ECU may write several rows a tick of its clock.

        Args:
            time: s, shape (n,); NaN where it was not logged.
            value: likewise.
        """
        there = np.isfinite(time) & np.isfinite(value)
        t = time[there]
        ahead = t > np.concatenate(([-np.inf], np.maximum.accumulate(t)[:-1]))
        return cls(t[ahead], value[there][ahead])

    @property
    def step(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def weight(self) -> np.ndarray:
        """Duration that each sample represents, s, shape (n,); a gap counts as one usual step."""
        ahead = np.append(np.diff(self.time), self.step)
        return np.where(ahead > self._longest, self.step, ahead)

    @property
    def pieces(self) -> tuple[Series, ...]:
        """The parts between its gaps."""
        ends = np.flatnonzero(np.diff(self.time) > self._longest) + 1
        parts = zip(np.split(self.time, ends), np.split(self.value, ends), strict=True)
        return tuple(Series(time, value) for time, value in parts)

    def busiest(self, duration: float) -> float:
        """Begin of the stretch of a duration (s) in which the signal travels furthest, s."""
        way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(self.value)))))
        ends = np.interp(self.time + duration, self.time, way)
        return float(self.time[int(np.argmax(ends - way))])

    @property
    def _longest(self) -> float:
        """Step that is no gap, s."""
        return max(5.0 * self.step, _GAP)


@dataclass(frozen=True, eq=False)
class DriveLog:
    """One log."""

    name: str  # of its file
    position: Series  # of the plate
    setpoint: Series | None  # the position that the ECU commands; None where it was not logged
    columns: Mapping[str, str] = field(default_factory=dict)  # header in the file of each quantity that was taken
    hint: str = ""  # what the log lacks, and how to name a quantity that was not found
    # other logged quantities of the throttle, see `others.py`: duty and a second position, %; both sensors, V
    others: Mapping[str, Series] = field(default_factory=dict)
    # closed and open voltage of the first sensor, where rig.toml's [tps] gives them
    tps: tuple[float, float] | None = None
