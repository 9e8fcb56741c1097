"""Which trace lies in which lane of a batch: little padding, and few different shapes to compile for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple


class Packing(NamedTuple):
    """Traces in lanes.

    Args:
        lanes: in each the places of its traces, one after the other.
        length: entries of every lane.
    """

    lanes: list[list[int]]
    length: int


def pack(lengths: Sequence[int], least: int = 0) -> Packing:
    """Longest first, each into the first lane with room; lanes are as long as the longest trace, rounded up.

    Args:
        lengths: entries of each trace.
        least: entries that a lane has at least.
    """
    length = max(least, rounded(max(lengths)))
    lanes: list[list[int]] = []
    free: list[int] = []
    for k in sorted(range(len(lengths)), key=lambda k: -lengths[k]):
        lane = next((j for j, room in enumerate(free) if room >= lengths[k]), None)
        if lane is None:
            lanes.append([])
            free.append(length)
            lane = len(lanes) - 1
        lanes[lane].append(k)
        free[lane] -= lengths[k]
    lanes += [[] for _ in range(rounded(len(lanes)) - len(lanes))]
    return Packing(lanes, length)


def rounded(n: int) -> int:
    """Up to a number of at most four significant bits, so that like folders share one compiled shape."""
    unit = max(1, 2 ** max(0, math.floor(math.log2(max(n, 1))) - 3))
    return unit * math.ceil(n / unit)
