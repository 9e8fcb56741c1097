"""How long before its first sample an edge of the voltage really came, from the rise of the current alone.

    y_j = (i_j - i_before) / (v_after - v_before) = (1 - a^(phi + j)) / R,   a = exp(-R dt / L),   j = 0, 1, 2, ...

With y_(j+1) = (1 - a)/R + a y_j every edge tells a and R; a robust line through those of all edges of a test is taken,
and with it each edge's own phase phi = log(1 - R y_0)/log a, in sample intervals: 0 where the edge came with the sample
that first shows it, 1 where it came a whole interval earlier. One clock for output and logger makes them all the same;
else they are uniform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...ranges import check_ranges, real, whole
from ..base import Measurement
from ..circle import arc_chance, on_circle, rayleigh_chance

MIN_RISE = 0.02  # part of its way that the current must go within one sample for a phase to be read
AFTER, BEFORE = 4, 3  # samples looked at


@dataclass(frozen=True)
class EdgeSettings:
    """When edges count as in step with the samples.

    Args:
        jump: noises of the voltage that an edge must reach.
        share: of the voltage's span, too.
        fewest: edges without which nothing is said.
        chance: probability of phases as close together by chance, at most.
        spread: of the phases about their mean, in sample intervals, at most.
        error: of a phase; less sure ones are left out.
    """

    jump: float = real(12.0, 0.0)
    share: float = real(0.1, 0.0, 1.0)
    fewest: int = whole(5, 2)
    chance: float = real(1e-4, 0.0, 1.0)
    spread: float = real(0.08, 0.0, 1.0)
    error: float = real(0.1, 0.0, 1.0)

    __post_init__ = check_ranges


@dataclass(frozen=True)
class EdgePhase:
    """Phase of the edges of one rig test, in sample intervals before the sample that first shows them.

    Args:
        phase: mean on the circle, 0 to 1; of edges on the samples the end that most of them show.
        error: its standard error.
        edges: how many told it.
        chance: probability that edges at any instants would have phases as close together: twice
            the lesser of Rayleigh's and that of the arc they lie in.
    """

    phase: float
    error: float
    edges: int
    chance: float


def edge_phase(traces: Sequence[Measurement], settings: EdgeSettings = EdgeSettings()) -> EdgePhase | None:
    """The common phase of the voltage's edges; None where they have none, or it cannot be told.

    Args:
        traces: of one rig test, with voltage and current.
        settings: what counts as common.
    """
    phases = edge_phases(traces, settings)
    if phases.size < settings.fewest:
        return None
    where = on_circle(phases)
    chance = min(1.0, 2.0 * min(rayleigh_chance(phases), arc_chance(phases)))
    if where.spread > settings.spread or chance > settings.chance:
        return None
    phase = float(np.clip(where.mean + np.round(np.median(phases) - where.mean), 0.0, 1.0))
    return EdgePhase(phase, where.spread / phases.size**0.5, phases.size, chance)


def edge_phases(traces: Sequence[Measurement], settings: EdgeSettings = EdgeSettings()) -> np.ndarray:
    """Of every edge that tells its phase, in sample intervals, shape (edges,)."""
    read = [row for trace in traces for row in _edges(trace, settings)]
    if not read:
        return np.empty(0)
    y = np.array([row[0] for row in read])
    noise = np.array([row[1] for row in read])
    a, R = _circuit(y)
    if not (0.0 < a < 1.0 - MIN_RISE and R > 0.0):
        return np.empty(0)
    left = 1.0 - R * y[:, 0]
    error = R * noise / (np.maximum(left, 1e-9) * -np.log(a))
    sure = (left > 0.0) & (error < settings.error)
    phases = np.log(left[sure]) / np.log(a)
    return phases[(phases > -0.3) & (phases < 1.3)]


def _circuit(y: np.ndarray) -> tuple[float, float]:
    """a and R of all edges together: y_(j+1) = (1 - a)/R + a y_j, medians of slope and level."""
    x, z = y[:, :-1].ravel(), y[:, 1:].ravel()
    slope, level = np.polyfit(x, z, 1) if np.ptp(x) > 0.0 else (0.0, 1.0)
    for _ in range(10):
        miss = np.abs(z - slope * x - level)
        near = miss <= max(3.0 * float(np.median(miss)), 1e-12)
        slope, level = np.polyfit(x[near], z[near], 1)
    return float(slope), float((1.0 - slope) / level) if level > 0.0 else -1.0


def _edges(trace: Measurement, settings: EdgeSettings) -> list[tuple[np.ndarray, float]]:
    """Of each lone edge the current's rise over the voltage's, A/V, shape (AFTER,), and the noise of one value."""
    voltage, current = trace.channels.get("voltage"), trace.channels.get("current")
    if voltage is None or current is None or not np.array_equal(voltage.time, current.time):
        return []
    change, v, i = np.diff(voltage.value), voltage.value, current.value
    large = np.abs(change) > max(settings.jump * voltage.sigma, settings.share * float(np.ptp(v)))
    out = []
    for k in np.flatnonzero(large) + 1:
        if (
            k < BEFORE + 1
            or k + AFTER + 1 > v.size
            or large[k - 1 - BEFORE : k - 1].any()
            or large[k : k + AFTER].any()
        ):
            continue
        jump = float(np.mean(v[k : k + AFTER]) - np.mean(v[k - BEFORE : k]))
        slope = (i[k - 1] - i[k - BEFORE]) / (BEFORE - 1)
        slope = slope if abs(slope) > 4.0 * current.sigma else 0.0
        start = np.mean(i[k - BEFORE : k]) + slope * (BEFORE - 1) / 2
        out.append(
            ((i[k : k + AFTER] - start - slope * np.arange(1, AFTER + 1)) / jump, 1.2 * current.sigma / abs(jump))
        )
    return out
