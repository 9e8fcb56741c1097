"""Finds voltage edges that are synchronous with the samples, from the rise of the current alone: the phase of an edge
is its time before the first sample that shows it.

    y_j = (i_j - i_before) / (v_after - v_before) = (1 - a^(phi + j)) / R,   a = exp(-R dt / L),   j = 0, 1, 2, ...

With y_(j+1) = (1 - a)/R + a y_j every edge gives a and R. A robust line through those of all edges of a test gives a
and R, and with them each edge's phase phi = log(1 - R y_0)/log a, in sample intervals: 0 where the edge coincides with
the sample that first shows it, 1 where it came a whole interval earlier. With one clock for output and logger all
phases are equal; otherwise they are uniform. A common phase is a habit, not a mistake, but it biases a fit that takes
the instants as independent.

Phases are points on a circle of one turn, where 0 and 1 are the same. Their mean, their spread, and the chance of so
small a spread:

    z = sum_k w_k exp(2 pi i p_k) / sum_k w_k,   mean = arg z / 2 pi,   spread = sqrt(-2 log |z|) / 2 pi

Source of the latter: Mardia and Jupp 2000, Directional Statistics, ch. 2 and 6. Differs from source: in turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base import Finding, Measurement
from ..signals import jumps
from .base import Records

MIN_RISE = 0.02  # least share of its rise that the current makes within one sample, for a phase to be read
AFTER, BEFORE = 4, 3  # samples that are used
JUMP, JUMP_SHARE = 12.0, 0.1  # least size of an edge: standard deviations of the noise, and share of the span
FEWEST = 5  # least number of edges of a finding
CHANCE = 1e-4  # largest probability of phases as close together by chance
SPREAD = 0.08  # largest spread of the phases about their mean, sample intervals
ERROR = 0.1  # largest standard error of a phase that is used


class OnCircle(NamedTuple):
    """Mean and mean vector of points on a circle."""

    mean: float  # turns, from -0.5 to 0.5
    length: float  # length of their mean vector: 1 where all are equal, 0 where they cancel

    @property
    def spread(self) -> float:
        """Standard deviation about the mean, turns."""
        return float(np.sqrt(-2.0 * np.log(min(self.length, 1.0 - 1e-12))) / (2.0 * np.pi))


def on_circle(points: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None) -> OnCircle:
    """Mean and mean vector of points, turns, weighted or with equal weights."""
    z = np.average(np.exp(2j * np.pi * points), weights=weights)
    return OnCircle(float(np.angle(z) / (2.0 * np.pi)), float(abs(z)))


def apart(points: Float[np.ndarray, " n"], mean: float) -> Float[np.ndarray, " n"]:
    """Distance of points ahead of a mean, in the shorter direction, turns."""
    return (points - mean + 0.5) % 1.0 - 0.5


def rayleigh_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = exp(-n |z|^2): probability that n random points have a mean vector as long, for n >= 5 (Rayleigh's test)."""
    return float(np.exp(-points.size * on_circle(points).length ** 2))


def arc_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = n w^(n-1): probability that n random points lie within an arc of w <= 1/2 turns (Stevens 1939)."""
    sorted_ = np.sort(points % 1.0)
    gaps = np.diff(sorted_, append=sorted_[0] + 1.0)
    w = 1.0 - float(gaps.max())
    return points.size * w ** (points.size - 1) if w <= 0.5 else 1.0


@dataclass(frozen=True)
class EdgePhase:
    """Phase of the edges of one rig test, in sample intervals before the sample that first shows them."""

    phase: float  # mean on the circle, 0 to 1; for edges on the samples the end (0 or 1) that most of them show
    error: float  # its standard error
    edges: int  # number of edges
    # probability that random edges have phases as close together: twice the smaller of Rayleigh's and that of the arc
    # that contains them
    chance: float


def synchronous_edges(records: Records) -> Iterator[Finding]:
    """One clock for output and logger: all edges of the voltage have the same phase in the sampling interval."""
    for test, traces in records.tests.items():
        found = edge_phase(traces)
        if found is not None:
            yield Finding("synchronous_edges", found.phase, "sample intervals", found.chance,
                          f"In {test} the voltage's edges are synchronous with the samples: all {found.edges} come "
                          f"{found.phase:.2f} +- {found.error:.2f} of an interval before the sample that first "
                          "shows them.",
                          "The files are right: the instants of one test share one phase, which the fit "
                          "estimates.", test, channel="voltage")  # fmt: skip


def edge_phase(traces: Sequence[Measurement]) -> EdgePhase | None:
    """The common phase of the voltage's edges in traces of one rig test; None where there is none."""
    phases = edge_phases(traces)
    if phases.size < FEWEST:
        return None
    where = on_circle(phases)
    chance = min(1.0, 2.0 * min(rayleigh_chance(phases), arc_chance(phases)))
    if where.spread > SPREAD or chance > CHANCE:
        return None
    phase = float(np.clip(where.mean + np.round(np.median(phases) - where.mean), 0.0, 1.0))
    return EdgePhase(phase, where.spread / phases.size**0.5, phases.size, chance)


def edge_phases(traces: Sequence[Measurement]) -> np.ndarray:
    """Phase of each edge that shows one, in sample intervals, shape (edges,)."""
    read = [row for trace in traces for row in _edges(trace)]
    if not read:
        return np.empty(0)
    y = np.array([row[0] for row in read])
    noise = np.array([row[1] for row in read])
    # a and R of all edges together: y_(j+1) = (1 - a)/R + a y_j, medians of slope and level
    x, z = y[:, :-1].ravel(), y[:, 1:].ravel()
    slope, level = np.polyfit(x, z, 1) if np.ptp(x) > 0.0 else (0.0, 1.0)
    for _ in range(10):
        miss = np.abs(z - slope * x - level)
        near = miss <= max(3.0 * float(np.median(miss)), 1e-12)
        slope, level = np.polyfit(x[near], z[near], 1)
    a, R = float(slope), float((1.0 - slope) / level) if level > 0.0 else -1.0
    if not (0.0 < a < 1.0 - MIN_RISE and R > 0.0):
        return np.empty(0)
    left = 1.0 - R * y[:, 0]
    error = R * noise / (np.maximum(left, 1e-9) * -np.log(a))
    sure = (left > 0.0) & (error < ERROR)
    phases = np.log(left[sure]) / np.log(a)
    return phases[(phases > -0.3) & (phases < 1.3)]


def _edges(trace: Measurement) -> list[tuple[np.ndarray, float]]:
    """For each lone edge: rise of the current over that of the voltage, A/V, shape (AFTER,), and noise of a value."""
    voltage, current = trace.channels.get("voltage"), trace.channels.get("current")
    if voltage is None or current is None or not np.array_equal(voltage.time, current.time):
        return []
    v, i, large = voltage.value, current.value, jumps(voltage, JUMP, JUMP_SHARE)
    out = []
    for k in np.flatnonzero(large) + 1:
        crowded = large[k - 1 - BEFORE : k - 1].any() or large[k : k + AFTER].any()
        if k < BEFORE + 1 or k + AFTER + 1 > v.size or crowded:
            continue
        jump = float(np.mean(v[k : k + AFTER]) - np.mean(v[k - BEFORE : k]))
        slope = (i[k - 1] - i[k - BEFORE]) / (BEFORE - 1)
        slope = slope if abs(slope) > 4.0 * current.sigma else 0.0
        start = np.mean(i[k - BEFORE : k]) + slope * (BEFORE - 1) / 2
        rise = (i[k : k + AFTER] - start - slope * np.arange(1, AFTER + 1)) / jump
        out.append((rise, 1.2 * current.sigma / abs(jump)))
    return out
