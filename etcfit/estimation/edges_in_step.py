"""Edges of the voltage that are in step with the samples, seen by a model that is near its data.

Where one clock drives output and logger, no edge comes at an instant of its own: all of a rig test share one place
between two samples, and a fit that takes each as independent and uniform is biased by what they share. The model is
simulated with every edge at the begin, the middle and the end of its interval; what the current did after each edge
tells where it came. Where those places agree within a test their phase becomes a parameter (`EdgePhase`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import stats

from ..model.rig_effects import EdgePhase, Place
from ..problem.free_parameters import free_parameters
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace, prepare
from ..rig.base import Measurement, Rig, Start
from ..rig.checks.edge_phase import arc_chance
from ..rig.checks.synchronous_edges import SynchronousEdges
from .settings import EdgeSettings

_SHARES = (0.0, 0.5, 1.0)  # of an interval, at which all edges are simulated
_TRIED = np.linspace(-0.25, 1.25, 301)  # at which the parabola through them is searched
_AFTER, _BEFORE = 60, 8  # samples of the current that may tell of an edge, at most
_FAINT = 0.1  # of what the instant of an edge changes at most, below which a sample tells nothing more of it


class EdgePlace(NamedTuple):
    """Where an edge came, as the model sees it.

    Args:
        interval: between which times of its trace.
        share: of that interval.
        sd: standard deviation of the share.
    """

    interval: int
    share: float
    sd: float


def with_edges_in_step(
    rig: Rig, problem: EstimationProblem, x: Float[np.ndarray, " P"], settings: EdgeSettings
) -> Rig | None:
    """The rig with the tests named whose edges are in step with the samples, each edge's turn and where the phases
    start; None where its records do not show that output and logger share a clock, or the model does not bear it out.

    Args:
        rig: as read.
        problem: of its fitted traces.
        x: coordinates near the optimum, shape (P,).
        settings: what counts as in step.
    """
    if not any(finding.kind == SynchronousEdges.kind for finding in rig.findings):
        return None
    tests = tuple(dict.fromkeys(t.test.name for t in problem.batch.traces if _jumps(t)))
    places = edge_places(rig, tests, problem, x)
    shared = {test: _common(list(_of(places, rig, test)), settings) for test in tests}
    alike = {test: c for test, c in shared.items() if c is not None and c.agreement >= settings.agreement}
    if not any(common.chance <= settings.chance for common in alike.values()):
        return None
    phases = {test: common.phase for test, common in alike.items()}
    turned = tuple(
        replace(m, edge_turn=_turns(m, places.get(m.file, ()), phases[m.test], settings)) if m.test in phases else m
        for m in rig.measurements
    )
    named = _named(replace(rig, measurements=turned), tuple(phases))
    starts = {symbol: Start(phase) for test, phase in phases.items() for symbol in _symbols(test)}
    return replace(named, config=replace(named.config, parameters={**starts, **named.config.parameters}))


def edge_places(
    rig: Rig, tests: Sequence[str], problem: EstimationProblem, x: Float[np.ndarray, " P"]
) -> Mapping[str, tuple[EdgePlace, ...]]:
    """Every edge of every trace of these tests, held-out ones too, by file.

    Args:
        rig: as read.
        tests: whose edges.
        problem: of its fitted traces.
        x: coordinates near the optimum, shape (P,).
    """
    config = _named(rig, tests).config
    known = free_parameters(config)
    traces = tuple(t for t in (prepare(m, config) for m in rig.measurements) if t is not None)
    values = problem.layout.values(x, problem.free_parameters.held)
    phases = [symbol for test in tests for symbol in _symbols(test)]

    def at(share: float) -> Float[np.ndarray, " P"]:
        return known.layout.coordinates({**values, **dict.fromkeys(phases, share)})

    tried = EstimationProblem.of(rig.config, known, traces).refined(at(0.5))
    seen = [tried.free_run(at(share)) for share in _SHARES]
    return {t.measurement.file: tuple(_read(t, paths)) for t, *paths in zip(tried.batch.traces, *seen, strict=True)}


def _jumps(trace: Trace) -> bool:
    return trace.circuit and trace.input is not None and bool(trace.input.edge.any()) and "current" in trace.channels


def _named(rig: Rig, tests: Sequence[str]) -> Rig:
    """The rig whose config names the effect for these tests."""
    names = dict.fromkeys((*rig.config.effects, *(EdgePhase.at(Place(test)).name for test in tests)))
    return replace(rig, config=replace(rig.config, effects=tuple(names)))


def _symbols(test: str) -> tuple[str, ...]:
    """That of the phase of a test's edges."""
    return tuple(EdgePhase.at(Place(test)).off or ())


def _of(places: Mapping[str, Sequence[EdgePlace]], rig: Rig, test: str) -> Iterator[EdgePlace]:
    """Those of all of one test's fitted traces."""
    yield from (p for m in rig.measurements if m.test == test and not m.held_out for p in places.get(m.file, ()))


def _read(trace: Trace, paths: Sequence[Float[np.ndarray, "n M"]]) -> Iterator[EdgePlace]:
    """The edges of a trace from its current, and from what simulations with edges at `_SHARES` make of that."""
    if not _jumps(trace) or trace.input is None:
        return
    m = trace.channels.index("current")
    data, sigma = trace.data[:, m], float(trace.sigma[m])
    early, middle, late = (path[:, m] for path in paths)
    edges = np.flatnonzero(trace.input.edge)
    begins, ends = np.append(-1, edges[:-1]), np.append(edges[1:], data.size - 1)
    for k, begin, end in zip(edges, begins, ends, strict=True):
        before = np.arange(max(begin + 1, k + 1 - _BEFORE), k + 1)
        after = np.arange(k + 1, min(k + 1 + _AFTER, end + 1))
        before, after = (rows[np.isfinite(data[rows])] for rows in (before, after))
        told = np.abs(late[after] - early[after])
        after = after[: after.size - int(np.argmax(told[::-1] > _FAINT * np.max(told, initial=0.0)))]
        if before.size and after.size > 1:
            level = float(np.mean(data[before] - middle[before]))
            paths_after = early[after], middle[after], late[after]
            share, sd = _place((data[after] - level) / sigma, [y / sigma for y in paths_after], before.size)
            yield EdgePlace(int(k), share, sd)


def _place(seen: Float[np.ndarray, " k"], paths: Sequence[Float[np.ndarray, " k"]], before: int) -> tuple[float, float]:
    """Where the parabola through three paths comes nearest to what was seen, all in noises, and how sure that is; the
    level of what was seen is a mean of `before` samples, an error that all share."""
    y0, y1, y2 = paths
    bend, slope = 2.0 * (y0 - 2.0 * y1 + y2), -3.0 * y0 + 4.0 * y1 - y2
    cost = np.sum((seen - y0 - np.outer(_TRIED, slope) - np.outer(_TRIED**2, bend)) ** 2, axis=1)
    best = int(np.argmin(cost))
    share = float(_TRIED[best])
    rate = slope + 2.0 * share * bend
    power, misfit = float(rate @ rate), max(1.0, float(cost[best]) / seen.size)
    if not power > 0.0:
        return share, np.inf
    return share, float(np.sqrt(misfit * (power + np.sum(rate) ** 2 / before)) / power)


class _Common(NamedTuple):
    """What the edges of one test share.

    Args:
        phase: from -border to 1 - border.
        chance: probability that edges at any instants lie as close together.
        agreement: probability that edges at this phase lie as far apart.
    """

    phase: float
    chance: float
    agreement: float


def _common(places: Sequence[EdgePlace], settings: EdgeSettings) -> _Common | None:
    """The phase nearest to all but a few; None where too few edges say anything, or they plainly differ."""
    sure = [p for p in places if p.sd < settings.error]
    if len(sure) < 2:
        return None
    share, sd = np.array([p.share for p in sure]), np.hypot([p.sd for p in sure], settings.scatter)
    phase = float(np.angle(np.sum(np.exp(2j * np.pi * share) / sd**2)) / (2.0 * np.pi))
    for _ in range(5):  # a few may be off: an edge that came between two others, say
        off = (share - phase + 0.5) % 1.0 - 0.5
        near = np.abs(off) < settings.far * sd
        if near.sum() < max(2, settings.near * off.size):
            return None
        phase += float(np.average(off[near], weights=1.0 / sd[near] ** 2))
    agreement = float(stats.chi2.sf(np.sum((off / sd)[near] ** 2), near.sum() - 1))
    phase %= 1.0
    phase -= phase > 1.0 - settings.border
    return _Common(phase, arc_chance(share[near]), agreement)


def _turns(
    measurement: Measurement, places: Sequence[EdgePlace], phase: float, settings: EdgeSettings
) -> Float[np.ndarray, " n-1"]:
    """Of each edge of a trace the turn that brings the phase nearest to where it came; NaN where it keeps no step."""
    out = np.full(measurement.time.size - 1, np.nan)
    inside = abs(phase - 0.5) < 0.5 - settings.border
    for place in places:
        turn = 0.0 if inside else float(np.round(np.clip(place.share - phase, 0.0, 1.0)))
        miss = abs(place.share - np.clip(phase + turn, 0.0, 1.0))
        keeps = miss < settings.far * np.hypot(place.sd, settings.scatter)
        told = inside or place.sd < settings.error
        out[place.interval] = turn if told and keeps else np.nan
    return out
