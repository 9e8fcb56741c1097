"""Edges of the voltage that are in step with the samples, detected by a model that is near its data.

If one clock drives output and logger, the instants of the edges are not independent: all edges of a rig test have the
same place between two samples, and a fit that assumes independent, uniform places is biased. The model is simulated
with every edge at the begin, the middle and the end of its interval; the current after each edge shows its place. If
the places agree within a test, their phase becomes a parameter (`EdgePhase`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from ..model.rig_effects import EdgePhase, Place
from ..problem.instants import SHARES, place
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from ..rig.base import Fixed, Measurement, Rig, Start
from ..rig.checks.edges import apart, arc_chance, on_circle
from .levenberg_marquardt import linearise_at
from .rounds import Reached

ERROR = 0.3  # standard deviation of one edge's place above which the edge is not used, sample intervals
SCATTER = 0.03  # allowed scatter of places about their phase, sample intervals
FAR = 4.0  # standard deviations from the phase above which an edge is out of step
NEAR = 0.8  # share of a test's edges that must be in step
CHANCE = 1e-3  # largest probability that edges at random instants agree as closely, in a test that proves one clock
AGREEMENT = 0.01  # least probability that edges in step scatter as widely, in every test taken to be in step
BORDER = 0.15  # phases so near a sample leave it open on which side of it an edge fell, sample intervals
ON_SAMPLE = 2.0  # standard errors by which a phase may lie inside its interval and yet be taken to be on the sample
IN_COMPANY = 3.0  # the same where the edges of another test are on the samples
_AFTER, _BEFORE = 60, 8  # largest numbers of samples of the current that are used for an edge
_FAINT = 0.1  # share of the largest change by an edge's instant, below which a sample is not used


class EdgePlace(NamedTuple):
    """The place of an edge, estimated by the model."""

    interval: int  # index of the interval between two times of its trace
    share: float  # place within that interval, 0 to 1
    sd: float  # standard deviation of the share


class Clocked(NamedTuple):
    """A rig whose output and logger share a clock."""

    rig: Rig  # the rig with the tests whose edges are in step with the samples, each edge's turn and the initial phases
    places: Mapping[str, Sequence[EdgePlace]]  # place of every edge, by file


def with_edges_in_step(
    rig: Rig, problem: EstimationProblem, held_out: Sequence[Trace], x: Float[np.ndarray, " P"]
) -> Clocked | None:
    """The rig with the phases that its edges show; None if they do not show that output and logger share a clock.

    Args:
        rig: the rig as read; if rig.toml names the effect itself, there is no search.
        held_out: its other traces: their edges have turns too, but are not used for the phase.
    """
    if any(effect.startswith(EdgePhase.kind) for effect in rig.config.effects):
        return None
    places = edge_places(problem, x)
    tests = dict.fromkeys(t.test.name for t in problem.batch.traces if _jumps(t))
    shared = {test: common_phase(list(_of(places, problem, test))) for test in tests}
    alike = {test: c for test, c in shared.items() if c is not None and c.agreement >= AGREEMENT}
    if not any(common.chance <= CHANCE for common in alike.values()):
        return None
    places |= edge_places(problem.for_traces(tuple(held_out), x), x) if held_out else {}
    turned = tuple(
        replace(m, edge_turn=turns(m, places.get(m.file, ()), alike[m.test].phase)) if m.test in alike else m
        for m in rig.measurements
    )
    effects = [EdgePhase.at(Place(test)) for test in alike]
    starts = {s: Start(c.phase) for effect, c in zip(effects, alike.values(), strict=True) for s in effect.off or ()}
    config = replace(
        rig.config,
        effects=(*rig.config.effects, *(effect.name for effect in effects)),
        parameters={**starts, **rig.config.parameters},
    )
    return Clocked(replace(rig, config=config, measurements=turned), places)


def phases_hold(problem: EstimationProblem, x: Float[np.ndarray, " P"]) -> bool:
    """Whether no free phase left its interval by more than one interval.

    Beyond the interval chi2 does not depend on the phase. A phase that went far shows that the model fits worse at both
    ends than between them: the model lacks an effect, and the phase does not describe the edges.
    """
    phases = (x[k] for k, symbol in enumerate(problem.layout.free) if symbol.startswith(f"{EdgePhase.kind}."))
    return all(-1.0 <= phase <= 2.0 for phase in phases)


def edge_places(problem: EstimationProblem, x: Float[np.ndarray, " P"]) -> dict[str, tuple[EdgePlace, ...]]:
    """Every edge of every trace, by file."""
    seen = (replace(problem, batch=problem.batch.jumping(share)).free_run(x) for share in SHARES)
    traces = problem.batch.traces
    return {t.measurement.file: tuple(_read(t, paths)) for t, *paths in zip(traces, *seen, strict=True)}


def _jumps(trace: Trace) -> bool:
    return trace.circuit and trace.input is not None and bool(trace.input.edge.any()) and "current" in trace.channels


def _of(places: Mapping[str, Sequence[EdgePlace]], problem: EstimationProblem, test: str) -> Iterator[EdgePlace]:
    """Places of all traces of one test."""
    yield from (p for t in problem.batch.traces if t.test.name == test for p in places[t.measurement.file])


def _read(trace: Trace, paths: Sequence[Float[np.ndarray, "n M"]]) -> Iterator[EdgePlace]:
    """Places of a trace's edges, from its current and from simulations with edges at `SHARES`."""
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
        change = np.abs(late[after] - early[after])
        after = after[: after.size - int(np.argmax(change[::-1] > _FAINT * np.max(change, initial=0.0)))]
        if before.size and after.size > 1:
            level = float(np.mean(data[before] - middle[before]))
            paths_after = early[after], middle[after], late[after]
            share, sd = place((data[after] - level) / sigma, [y / sigma for y in paths_after], before.size)
            yield EdgePlace(int(k), share, sd)


class CommonPhase(NamedTuple):
    """The common phase of the edges of one test."""

    phase: float  # from -border to 1 - border
    chance: float  # probability that edges at random instants lie as close together
    agreement: float  # probability that edges at this phase scatter as widely


def common_phase(places: Sequence[EdgePlace]) -> CommonPhase | None:
    """The phase nearest to nearly all edges; None if too few edges have a place, or the places clearly differ."""
    sure = [p for p in places if p.sd < ERROR]
    if len(sure) < 2:
        return None
    share, sd = np.array([p.share for p in sure]), np.hypot([p.sd for p in sure], SCATTER)
    phase = on_circle(share, 1.0 / sd**2).mean
    for _ in range(5):  # a few may be off, such as an edge between two others
        off = apart(share, phase)
        near = np.abs(off) < FAR * sd
        if near.sum() < 2:
            return None
        phase += float(np.average(off[near], weights=1.0 / sd[near] ** 2))
    # an action more than one sample late is a delay, not a phase
    within = (share > -BORDER - sd) & (share < 1.0 + BORDER + sd)
    if np.sum(near & within) < NEAR * share.size:
        return None
    agreement = float(chdtrc(near.sum() - 1, np.sum((off / sd)[near] ** 2)))
    phase %= 1.0
    phase -= phase > 1.0 - BORDER
    return CommonPhase(phase, arc_chance(share[near]), agreement)


def turns(measurement: Measurement, places: Sequence[EdgePlace], phase: float) -> Float[np.ndarray, " n-1"]:
    """For each edge of a trace, the turn that brings the phase nearest to its place; NaN if it is out of step."""
    out = np.full(measurement.time.size - 1, np.nan)
    inside = abs(phase - 0.5) < 0.5 - BORDER
    for edge in places:
        turn = 0.0 if inside else float(np.round(np.clip(edge.share - phase, 0.0, 1.0)))
        miss = abs(edge.share - np.clip(phase + turn, 0.0, 1.0))
        keeps = miss < FAR * np.hypot(edge.sd, SCATTER)
        placed = inside or edge.sd < ERROR
        out[edge.interval] = turn if placed and keeps else np.nan
    return out


# ---- Edges exactly on the samples: whether the edges of a test lie on a sample or between two is decided, not
# estimated.
#
# A fixed-step simulation, or a loop that writes and samples in one tick, jumps at the sample instants themselves, and
# the sample there shows the input before the jump (turn 0) or after it (turn 1). The phase is then at the end of its
# interval: the likelihood is one-sided, no gradient vanishes, and no interval is right. So this is a decision between
# few hypotheses by likelihood: on the sample, if chi2 is lowest there, or lower inside by no more than chance,
#
#     z = inside / sd < on_sample,    inside = phase from the sample into the interval, sd its standard error
#
# and otherwise a free phase. One clock drives all tests: the phase of tests with a sharp phase applies to all tests
# that do not contradict it.

_HAIR = 1e-5  # intervals; the likelihood is evaluated so far inside the interval

Places = Mapping[str, Sequence[EdgePlace]]  # by file


class Decided(NamedTuple):
    """The decision on the edges near the samples."""

    rig: Rig  # the rig with the phases fixed that put the edges of a test on the samples
    x: Float[np.ndarray, " P"]  # coordinates of the model before, from which to fit the rig, shape (P,)


class _Phase(NamedTuple):
    """The phase of one test whose edges come near the samples."""

    test: str  # name of the test
    index: int  # index of the phase's coordinate
    side: float  # sign of phases inside the interval; 0 if edges lie on both sides of their samples


def with_edges_on_samples(rig: Rig, reached: Reached, places: Places) -> Decided | None:
    """Decide which tests have their edges on the samples; None if none has, and the fit remains unchanged.

    Args:
        rig: the rig with the tests whose edges are in step, see `with_edges_in_step`.
        places: places of all edges, estimated without a common phase.
    """
    near = list(_near_a_sample(reached.problem, reached.x))
    if not near:
        return None
    x, at = reached.x.copy(), [phase.index for phase in near]
    for phase in near:  # beyond the sample chi2 does not depend on the phase
        if phase.side and phase.side * x[phase.index] < _HAIR:
            x[phase.index] = phase.side * _HAIR
    here = linearise_at(reached.problem, x, reached.weighted)
    best, sd = (x + here.step)[at], np.sqrt(np.diag(here.covariance))[at]
    inside = np.array([phase.side * b if phase.side else abs(b) for phase, b in zip(near, best, strict=True)])
    sharp = (sd < SCATTER) & (inside < ON_SAMPLE * sd)
    on = inside < (IN_COMPANY * sd if sharp.any() else 0.0)
    missed = ~on & (x[at] != reached.x[at])  # chi2 is lower inside, and the descent had left the interval
    if not np.any(on | missed):
        return None
    x[at] = np.where(missed, best, x[at])
    sides = {phase.side for phase, yes in zip(near, sharp, strict=True) if yes}
    fixed = rig
    if len(sides) == 1 and 0.0 not in sides:
        between = {phase.test for phase, yes in zip(near, ~on & (sd < SCATTER), strict=True) if yes}
        others = {f: each for f, each in places.items() if f.partition("/")[0] not in between}
        fixed = _with_common_turn(rig, others, 0.0 if sides == {1.0} else 1.0)
    return Decided(_on_samples(fixed, [phase.test for phase, yes in zip(near, on, strict=True) if yes]), x)


def accepts(places: Sequence[EdgePlace], turn: float) -> bool:
    """Whether the edges of a test may all be on the samples: chi2 rises by no more than chance over its minimum for one
    common share. Edges that are too weak to have a place of their own count together.

    Args:
        places: places of its edges.
        turn: 0 or 1: the place, as a share of the interval, of edges on the samples.
    """
    share = np.array([p.share for p in places])
    weight = 1.0 / np.hypot([p.sd for p in places], SCATTER) ** 2
    if not weight.sum() > 0.0:
        return True
    return abs(float(np.average(share, weights=weight)) - turn) * weight.sum() ** 0.5 < IN_COMPANY


def _with_common_turn(rig: Rig, places: Places, turn: float) -> Rig:
    """The rig with this turn for all edges of all tests that accept it, and their phases on the sample."""
    files = {m.file: m.test for m in rig.measurements if places.get(m.file)}
    tests = [test for test in dict.fromkeys(files.values())
             if accepts([p for f, t in files.items() if t == test for p in places[f]], turn)]  # fmt: skip
    turned = tuple(
        replace(m, edge_turn=_all(turn, m, places[m.file])) if files.get(m.file) in tests else m
        for m in rig.measurements
    )
    return _on_samples(replace(rig, measurements=turned), tests)


def _all(turn: float, measurement: Measurement, places: Sequence[EdgePlace]) -> Float[np.ndarray, " n-1"]:
    """This turn for every edge of a trace except those that are clearly elsewhere; NaN where there is no edge."""
    out = np.full(measurement.time.size - 1, np.nan)
    for edge in places:
        if abs(edge.share - turn) < FAR * np.hypot(edge.sd, SCATTER):
            out[edge.interval] = turn
    return out


def _on_samples(rig: Rig, tests: Sequence[str]) -> Rig:
    """The rig with the phases of these tests known."""
    effects = [EdgePhase.at(Place(test)) for test in tests]
    named = dict.fromkeys((*rig.config.effects, *(effect.name for effect in effects)))
    known = {symbol: Fixed(0.0) for effect in effects for symbol in effect.off or ()}
    config = replace(rig.config, effects=tuple(named), parameters={**rig.config.parameters, **known})
    return replace(rig, config=config)


def _near_a_sample(problem: EstimationProblem, x: Float[np.ndarray, " P"]) -> Iterator[_Phase]:
    """The free phases of the tests whose edges come near the samples."""
    free = problem.layout.free
    for test in dict.fromkeys(trace.test.name for trace in problem.batch.traces):
        symbol = f"{EdgePhase.kind}.{test}"
        if symbol in free and abs(x[free.index(symbol)]) < BORDER:
            turns = _turns(problem, test)
            late, early = bool(np.any(turns > 0.5)), bool(np.any(turns < 0.5))
            yield _Phase(test, free.index(symbol), float(early) - float(late))


def _turns(problem: EstimationProblem, test: str) -> Float[np.ndarray, " edges"]:
    """The turn, 0 or 1, of every edge in step of a test."""
    inputs = [trace.input for trace in problem.batch.traces if trace.test.name == test]
    return np.concatenate([s.turn[s.in_step] for s in inputs if s is not None and s.turn is not None] or [np.empty(0)])
