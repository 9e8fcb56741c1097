"""How long before its first sample an edge of the voltage really came, from the rise of the current alone.

    y_j = (i_j - i_before) / (v_after - v_before) = (1 - a^(phi + j)) / R,   a = exp(-R dt / L),   j = 0, 1, 2, ...

With y_(j+1) = (1 - a)/R + a y_j every edge gives a and R; a robust line through those of all edges of a test is taken,
and with it each edge's own phase phi = log(1 - R y_0)/log a, in sample intervals: 0 where the edge came with the sample
that first shows it, 1 where it came a whole interval earlier. One clock for output and logger makes them all the same;
else they are uniform. A common phase is a habit, no mistake, but a fit that takes each instant as independent is biased
by it.

Phases are points on a circle of one turn, where 0 and 1 are the same: their mean, how far they lie apart, and by what
chance they lie so close together.

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

MIN_RISE = 0.02  # part of its way that the current must go within one sample for a phase to be read
AFTER, BEFORE = 4, 3  # samples looked at
JUMP, JUMP_SHARE = 12.0, 0.1  # noises of the voltage, and share of its span, that an edge must reach
FEWEST = 5  # edges without which nothing is said
CHANCE = 1e-4  # probability of phases as close together by chance, at most
SPREAD = 0.08  # of the phases about their mean, in sample intervals, at most
ERROR = 0.1  # of a phase; less sure ones are left out


class OnCircle(NamedTuple):
    """Where points lie."""

    mean: float  # turns, from -0.5 to 0.5
    length: float  # of their mean vector: 1 where all are the same, 0 where they cancel

    @property
    def spread(self) -> float:
        """Standard deviation about the mean, turns."""
        return float(np.sqrt(-2.0 * np.log(min(self.length, 1.0 - 1e-12))) / (2.0 * np.pi))


def on_circle(points: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None) -> OnCircle:
    """Where points lie, turns; each counts as its weight, or all alike."""
    z = np.average(np.exp(2j * np.pi * points), weights=weights)
    return OnCircle(float(np.angle(z) / (2.0 * np.pi)), float(abs(z)))


def apart(points: Float[np.ndarray, " n"], mean: float) -> Float[np.ndarray, " n"]:
    """Distance of points ahead of a mean, the shorter way round, turns."""
    return (points - mean + 0.5) % 1.0 - 0.5


def rayleigh_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = exp(-n |z|^2): that n points at random have a mean vector as long, for n of 5 or more (Rayleigh's test)."""
    return float(np.exp(-points.size * on_circle(points).length ** 2))


def arc_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = n w^(n-1): that n points at random lie within an arc of w <= 1/2 turns (Stevens 1939)."""
    sorted_ = np.sort(points % 1.0)
    gaps = np.diff(sorted_, append=sorted_[0] + 1.0)
    w = 1.0 - float(gaps.max())
    return points.size * w ** (points.size - 1) if w <= 0.5 else 1.0


@dataclass(frozen=True)
class EdgePhase:
    """Phase of the edges of one rig test, in sample intervals before the sample that first shows them."""

    phase: float  # mean on the circle, 0 to 1; of edges on the samples the end that most of them show
    error: float  # its standard error
    edges: int  # how many it was read from
    # probability that edges at any instants would have phases as close together: twice the lesser of Rayleigh's and
    # that of the arc they lie in
    chance: float


def synchronous_edges(records: Records) -> Iterator[Finding]:
    """One clock for output and logger: every edge of the voltage comes at the same phase of the sampling interval."""
    for test, traces in records.tests.items():
        found = edge_phase(traces)
        if found is not None:
            yield Finding("synchronous_edges", found.phase, "sample intervals", found.chance,
                          f"In {test} the voltage's edges are in step with the samples: all {found.edges} come "
                          f"{found.phase:.2f} +- {found.error:.2f} of an interval before the sample that first "
                          "shows them.",
                          "Nothing in the files is wrong: the instants of one test share one phase, which the fit "
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
