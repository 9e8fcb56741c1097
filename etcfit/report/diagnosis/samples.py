"""Missing torque and voltage of all traces together, and the median curve of it over one quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...diagnose.findings import Motion

_BINS = 40
_FEWEST = 12  # samples of a bin that is drawn
_CLIPPED = 0.002  # of the samples at either end of an axis lie outside the picture
_LOSES = 1e-9  # of the missing torque; an effect that contributes no more acts elsewhere


@dataclass(frozen=True, eq=False)
class Samples:
    """What is missing, all traces end to end, shape (n,) each; only where it is known before and after.

    Args:
        axes: by name, see `Motion`.
        before, after: missing with the first and with the final model, SI.
        effects: what each added effect contributes there, SI; without those that contribute nothing.
    """

    axes: Mapping[str, np.ndarray]
    before: np.ndarray
    after: np.ndarray
    effects: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, motions: Sequence[Motion], enters: str) -> Samples:
        """Collect "torque" or "voltage"."""
        names = dict.fromkeys(name for motion in motions for name in motion.effects)
        before = _end_to_end([getattr(motion, enters) for motion in motions])
        after = _end_to_end([motion.after[enters] for motion in motions])
        seen = np.isfinite(before) & np.isfinite(after)
        axes = {a: _end_to_end([motion.axes[a] for motion in motions])[seen] for a in (motions[0].axes if motions else ())}
        every = {name: _end_to_end([_of_effect(m, name, enters) for m in motions])[seen] for name in names}
        size = _LOSES * float(np.sqrt(np.mean(before[seen] ** 2))) if seen.any() else 0.0
        acting = {name: part for name, part in every.items() if np.any(np.abs(part) > size)}
        return cls(axes, before[seen], after[seen], acting)

    def of_rows(self, rows: np.ndarray) -> Samples:
        """Some of them."""
        return Samples({a: v[rows] for a, v in self.axes.items()}, self.before[rows], self.after[rows],
                       {name: part[rows] for name, part in self.effects.items()})  # fmt: skip


def _end_to_end(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.asarray(part, dtype=float) for part in parts]) if parts else np.empty(0)


def _of_effect(motion: Motion, name: str, enters: str) -> np.ndarray:
    part = motion.effects.get(name, {}).get(enters)
    return np.zeros(motion.torque.size) if part is None else np.nan_to_num(np.asarray(part, dtype=float))


@dataclass(frozen=True, eq=False)
class Bins:
    """Equal steps along an axis.

    Args:
        edges: shape (B + 1,).
        place: bin of each sample, shape (n,); outside 0 ... B-1 where it lies beyond the edges.
    """

    edges: np.ndarray
    place: np.ndarray

    @classmethod
    def along(cls, axis: np.ndarray) -> Bins:
        """Over nearly all of the range: stray samples at the ends would leave no room for the others."""
        low, high = np.quantile(axis, (_CLIPPED, 1.0 - _CLIPPED))
        edges = np.linspace(low, max(high, low + 1e-12), _BINS + 1)
        return cls(edges, np.digitize(axis, edges) - 1)

    @property
    def centres(self) -> np.ndarray:
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    def quartiles(self, y: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """Lower quartile, median and upper quartile in each bin, shape (3, B); NaN where there are too few samples."""
        rows = np.ones(y.size, dtype=bool) if rows is None else rows
        out = np.full((3, _BINS), np.nan)
        for k in range(_BINS):
            mine = y[rows & (self.place == k)]
            if mine.size >= _FEWEST:
                out[:, k] = np.quantile(mine, (0.25, 0.5, 0.75))
        return out


def directions_differ(samples: Samples) -> bool:
    """True where opening and closing make two curves over the angle, apart by more than their own spread."""
    if not {"angle", "speed"} <= set(samples.axes):
        return False
    bins, speed = Bins.along(samples.axes["angle"]), samples.axes["speed"]
    ways = [bins.quartiles(samples.before, rows) for rows in (speed > 0.0, speed < 0.0)]
    apart, spread = np.abs(ways[0][1] - ways[1][1]), 0.5 * sum(way[2] - way[0] for way in ways)
    both = np.isfinite(apart)
    return bool(both.sum() > 4 and np.median(apart[both]) > np.median(spread[both]))


def curve_rms(bins: Bins, y: np.ndarray) -> float:
    """Root mean square of the median curve: what is missing by rule, not by chance."""
    median = bins.quartiles(y)[1]
    seen = np.isfinite(median)
    return float(np.sqrt(np.mean(median[seen] ** 2))) if seen.any() else 0.0
