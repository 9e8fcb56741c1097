"""Distribution of traces over the lanes of a batch, with little padding and few different shapes to compile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple


class Packing(NamedTuple):
    """Traces in lanes.

    Args:
        lanes: for each lane, the numbers of its traces in sequence.
        length: number of entries of every lane.
    """

    lanes: list[list[int]]
    length: int


def pack(lengths: Sequence[int], least: int = 0) -> Packing:
    """The longest trace first, each into the first lane with enough space; lanes are as long as the longest trace,
    rounded up.

    Args:
        lengths: number of entries of each trace.
        least: least number of entries of a lane.
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
    """Round up to a number of at most four significant bits, so that similar folders share one compiled shape."""
    unit = max(1, 2 ** max(0, math.floor(math.log2(max(n, 1))) - 3))
    return unit * math.ceil(n / unit)
