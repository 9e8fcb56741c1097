"""Models in which something fails: the nominal one, and it hot and cold with little and much dry friction."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..pid.base import Task
from ..pid.conditions import Conditions, under
from ..pid.loop import Loop


def bench_and_extremes(task: Task) -> Loop:
    """The nominal model as at the bench, then at each corner of winding and friction, under the ECU's own supply."""
    ranges = task.settings.conditions
    rows = [(ranges.bench, 1.0), *product(ranges.winding, ranges.friction)]
    winding, friction = np.array(rows).T
    conditions = Conditions(np.full(len(rows), task.ecu.supply), winding, friction)
    return under(task.loop.taking(np.zeros(len(rows), dtype=int)), conditions, ranges)
