"""Ends of the integration steps of a trace."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .trace import Trace


class Breaks(NamedTuple):
    """Ends of the steps of a trace."""

    ends: Float[np.ndarray, " rows"]  # ends of all steps, s; the first is the trace's first instant
    interval: Int[np.ndarray, " rows"]  # the interval between instants in which each step lies
    marks: Int[np.ndarray, " n"]  # the step that ends at each of the n instants


def breaks_of(trace: Trace, substeps: Int[np.ndarray, " intervals"]) -> Breaks:
    """The steps of a trace, `substeps` of them in each interval and one more where the release splits one."""
    t = trace.instants
    interval = np.repeat(np.arange(substeps.size), substeps)
    place = np.arange(interval.size) - np.repeat(np.cumsum(substeps) - substeps, substeps) + 1
    ends = t[interval] + (t[interval + 1] - t[interval]) * place / substeps[interval]
    marks = np.concatenate(([0], np.cumsum(substeps)))
    ends = np.concatenate((t[:1], ends))
    interval = np.concatenate(([0], interval))
    if trace.release is not None:  # the release always splits one step, so that shapes do not depend on it
        at = int(np.clip(np.searchsorted(ends, trace.release[0]), 1, ends.size - 1))
        ends = np.insert(ends, at, np.clip(trace.release[0], ends[at - 1], ends[at]))
        interval = np.insert(interval, at, interval[at])
        marks = np.where(marks >= at, marks + 1, marks)
    return Breaks(ends, interval, marks)
