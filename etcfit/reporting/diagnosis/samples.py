"""Missing torque and voltage of all traces together, and the median curve of it over one quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...diagnosis.findings import Motion

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
        axes = {
            a: _end_to_end([motion.axes[a] for motion in motions])[seen] for a in (motions[0].axes if motions else ())
        }
        every = {name: _end_to_end([_of_effect(m, name, enters) for m in motions])[seen] for name in names}
        size = _LOSES * float(np.sqrt(np.mean(before[seen] ** 2))) if seen.any() else 0.0
        acting = {name: part for name, part in every.items() if np.any(np.abs(part) > size)}
        return cls(axes, before[seen], after[seen], acting)


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

    def quartiles(self, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Lower quartile, median and upper quartile in each bin, shape (3, B); NaN where there are too few samples."""
        out = np.full((3, _BINS), np.nan)
        for k in range(_BINS):
            mine = y[rows & (self.place == k)]
            if mine.size >= _FEWEST:
                out[:, k] = np.quantile(mine, (0.25, 0.5, 0.75))
        return out


def ways(samples: Samples, axis: str) -> tuple[np.ndarray, ...]:
    """Rows that make one curve each, shape (n,): all, or, over the angle, opening and closing where these make two
    curves, apart by more than their own spread."""
    every = (np.ones(samples.before.size, dtype=bool),)
    if axis != "angle" or "speed" not in samples.axes:
        return every
    bins, speed = Bins.along(samples.axes["angle"]), samples.axes["speed"]
    both = speed > 0.0, speed < 0.0
    opening, closing = (bins.quartiles(samples.before, rows) for rows in both)
    apart, spread = np.abs(opening[1] - closing[1]), 0.5 * (opening[2] - opening[0] + closing[2] - closing[0])
    seen = np.isfinite(apart)
    return both if seen.sum() > 4 and np.median(apart[seen]) > np.median(spread[seen]) else every


def curve_rms(bins: Bins, y: np.ndarray, curves: Sequence[np.ndarray]) -> float:
    """Root mean square of the median curves, one of each set of rows: what is missing by rule, not by chance."""
    medians = np.concatenate([bins.quartiles(y, rows)[1] for rows in curves])
    seen = np.isfinite(medians)
    return float(np.sqrt(np.mean(medians[seen] ** 2))) if seen.any() else 0.0
