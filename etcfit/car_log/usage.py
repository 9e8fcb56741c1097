"""At which positions the plate spends its time: a histogram of a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .log import Series

SHARE = 0.77  # share of the time that the paper finds between 5 and 45 %
BOUNDS = 5.0, 45.0  # per cent: the positions of that share
_BIN = 5.0  # per cent, as in Fig. 6 (a)


@dataclass(frozen=True, eq=False)
class Usage:
    """Operating range, Fig. 6 (a)."""

    edges: np.ndarray  # of the bins, per cent of travel, shape (n + 1,)
    shares: np.ndarray  # of the time in each bin, shape (n,), sums to 1
    bounds: tuple[float, float]  # two positions, per cent
    between: float  # share of the time between them
    shortest: tuple[float, float]  # the shortest interval that holds 77 % of the time, per cent


def usage(position: Series, bounds: tuple[float, float] = BOUNDS) -> Usage:
    """The histogram of a position over time, each sample weighed by its duration.

    Args:
        position: per cent.
        bounds: two positions between which the share of time is given, per cent.
    """
    value, weight = position.value, position.weight / position.weight.sum()
    low, high = (_BIN * np.floor(value.min() / _BIN), _BIN * (np.floor(value.max() / _BIN) + 1.0))
    edges = np.arange(min(0.0, low), max(100.0, high) + 0.5 * _BIN, _BIN)
    shares, _ = np.histogram(value, edges, weights=weight)
    inside = (value >= bounds[0]) & (value <= bounds[1])
    return Usage(edges, shares, bounds, float(weight[inside].sum()), shortest(value, weight, SHARE))


def shortest(value: np.ndarray, weight: np.ndarray, share: float) -> tuple[float, float]:
    """The shortest interval that holds a share of the weight; an interval upwards from each value is tried.

    Args:
        value: shape (n,).
        weight: shape (n,), sums to 1.
        share: 0 to 1.
    """
    order = np.argsort(value, kind="stable")
    rising, below = value[order], np.concatenate(([0.0], np.cumsum(weight[order])))
    last = np.searchsorted(below[1:], below[:-1] + share - 1e-12)
    fits = last < rising.size
    length = rising[last[fits]] - rising[fits]
    k = int(np.argmin(length))
    return float(rising[fits][k]), float(rising[last[fits][k]])
