"""Long traces in as many points as there is room for, none of their extremes lost: least and most of each bin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Bins:
    """Runs of samples next to each other, each of which becomes two points.

    Args:
        starts: first sample of each bin, shape (B,); every sample is its own where the trace is short.
        size: samples n.
    """

    starts: np.ndarray
    size: int

    @classmethod
    def of(cls, size: int, most: int) -> Bins:
        """Bins of n samples, at most so many points."""
        if size <= most:
            return cls(np.arange(size), size)
        return cls(np.unique(np.linspace(0, size, max(1, most // 2), endpoint=False).astype(int)), size)

    @property
    def whole(self) -> bool:
        """True where every sample is there."""
        return self.starts.size == self.size

    def instants(self, time: np.ndarray) -> np.ndarray:
        """Of the points: a quarter and three quarters into each bin, s; shape (n,) or (2 B,)."""
        if self.whole:
            return time
        ends = np.append(self.starts[1:], self.size) - 1
        begin, span = time[self.starts], time[ends] - time[self.starts]
        return np.stack([begin + 0.25 * span, begin + 0.75 * span], axis=1).ravel()

    def extremes(self, value: np.ndarray) -> np.ndarray:
        """Least and most of each bin in the order in which they came, shape as of `instants`; NaN of an empty one."""
        if self.whole:
            return value
        size = np.diff(np.append(self.starts, self.size))
        places = self.starts[:, None] + np.arange(size.max())
        inside = np.less(np.arange(size.max()), size[:, None])
        piece = np.where(inside, value[np.minimum(places, self.size - 1)], np.nan)
        seen = np.isfinite(piece)
        lowest, highest = np.where(seen, piece, np.inf).argmin(axis=1), np.where(seen, piece, -np.inf).argmax(axis=1)
        both = np.sort(np.stack([lowest, highest], axis=1), axis=1)
        return np.where(np.any(seen, axis=1, keepdims=True), np.take_along_axis(piece, both, axis=1), np.nan).ravel()
