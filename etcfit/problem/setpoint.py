"""The setpoint of an ECU that is part of the model, and the instants at which the ECU read its jumps.

A setpoint that jumps between two samples was read at an unlogged tick: after the sample before the jump, and no later
than one period after the sample that shows it. The plate's motion after each jump determines its place in that window
(`EstimationProblem.with_setpoint_jumps`); the ECU's clock is assumed to be in step with each jump.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from ..rig.base import Measurement
from .input_signal import edges_of
from .instants import place

SAME_INSTANT = 1e-9  # s; instants closer than this are equal
_BEFORE, _AFTER = 8, 0.03  # samples before a jump, and s after it, that determine when it was read
_UNIFORM = 1.0 / 12.0  # variance of an unknown share of the window


@dataclass(frozen=True, eq=False)
class Setpoint:
    """The setpoint of a trace at its instants; linear in between, except where it jumps."""

    instants: Float[np.ndarray, " n"]  # s, shape (n,)
    value: Float[np.ndarray, " n"]  # rad, shape (n,)
    jumps: Int[np.ndarray, " k"]  # intervals between instants in which it jumps, shape (k,)
    share: Float[np.ndarray, " k"]  # place in its window at which the ECU read each jump, 0 to 1, shape (k,)
    period: float  # period of the ECU's clock, s

    @classmethod
    def of_measurement(cls, measurement: Measurement, period: float) -> Setpoint:
        """The logged setpoint, with each jump read in the middle of its window."""
        channel, instants = measurement.channels["setpoint"], measurement.time
        value = np.interp(instants, channel.time, channel.value)
        jumps = np.flatnonzero(edges_of(value, channel.error))
        return cls(instants, value, jumps, np.full(jumps.size, 0.5), period)

    @property
    def windows(self) -> Float[np.ndarray, " k"]:
        """Length of the window of each jump, s."""
        return np.diff(self.instants)[self.jumps] + self.period

    @property
    def seen(self) -> Float[np.ndarray, " k"]:
        """Instants at which the ECU read each jump, s."""
        return np.maximum.accumulate(self.instants[self.jumps] + self.share * self.windows)

    @property
    def seen_sd(self) -> Float[np.ndarray, " k"]:
        """Standard deviation of those instants, s: that of the whole window, because the errors of the jumps are
        correlated."""
        return self.windows

    def with_jumps_at(self, share: float | Float[np.ndarray, " k"]) -> Setpoint:
        """The setpoint with each jump read at this share of its window."""
        return replace(self, share=np.broadcast_to(share, self.share.shape))

    def at(self, instants: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """The setpoint that the ECU read, rad, at any instants, s."""
        after, seen = self.jumps + 1, self.seen
        known = self.instants.copy()
        known[after] = np.maximum(known[after], seen)  # a sample may show a value that the ECU reads a little later
        time = np.insert(known, np.repeat(after, 2), np.stack((seen - SAME_INSTANT, seen), axis=1).ravel())
        value = np.insert(self.value, np.repeat(after, 2),
                          np.stack((self.value[self.jumps], self.value[after]), axis=1).ravel())  # fmt: skip
        return np.interp(instants, np.maximum.accumulate(time), value)

    def placed(self, data: Float[np.ndarray, " n"], sigma: float, paths: Sequence[Float[np.ndarray, " n"]]) -> Setpoint:
        """The setpoint with each jump read at the instant that best fits the plate, as far as the data determine it.

        Args:
            data: angle, rad; NaN where it was not logged.
            sigma: its noise, rad.
            paths: simulated, with all jumps at the begin, the middle and the end of their windows.
        """
        if not self.jumps.size:
            return self
        found = [self._share(data, sigma, paths, k, last) for k, last in self._reaches()]
        return self.with_jumps_at(np.array(found))

    def _reaches(self) -> Iterator[tuple[int, int]]:
        """Each jump's interval, and the last sample that depends on no later jump."""
        ends = np.searchsorted(self.instants, self.instants[self.jumps] + _AFTER)
        last = np.minimum(ends, np.append(self.jumps[1:], self.instants.size - 1))
        yield from zip(self.jumps.tolist(), last.tolist(), strict=True)

    def _share(
        self, data: Float[np.ndarray, " n"], sigma: float, paths: Sequence[Float[np.ndarray, " n"]], k: int, last: int
    ) -> float:
        before, after = np.arange(max(k + 1 - _BEFORE, 0), k + 1), np.arange(k + 1, last + 1)
        before, after = (rows[np.isfinite(data[rows])] for rows in (before, after))
        if not before.size or after.size < 2:
            return 0.5
        level = float(np.mean(data[before] - paths[1][before]))
        share, sd = place((data[after] - level) / sigma, [path[after] / sigma for path in paths], before.size)
        belief = sd**2 / (sd**2 + _UNIFORM) if math.isfinite(sd) else 1.0
        return float(np.clip(share + belief * (0.5 - share), 0.0, 1.0))
