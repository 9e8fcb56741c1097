"""Edges exactly on the samples: whether the edges of a test lie on a sample or between two is decided, not estimated.

A fixed-step simulation, or a loop that writes and samples in one tick, jumps at the sample instants themselves, and the
sample there shows the input before the jump (turn 0) or after it (turn 1). The phase is then at the end of its
interval: the likelihood has one side, no gradient vanishes, and no interval is right. So this is a question with few
answers, by likelihood: on the sample, where chi2 is lowest there, or lower inside by no more than chance,

    z = inside / sd < on_sample,    inside = phase from the sample into the interval, sd its standard error

and else a free phase. One clock drives all tests: what tests with a sharp phase show holds for all that do not
contradict it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.rig_effects import EdgePhase, Place
from ..problem.problem import EstimationProblem
from ..rig.base import Fixed, Measurement, Rig
from .edges_in_step import EdgePlace
from .levenberg_marquardt import local
from .rounds import Reached
from .settings import EdgesInStepSettings

_HAIR = 1e-5  # intervals; so near a sample the likelihood is looked at from inside

Places = Mapping[str, Sequence[EdgePlace]]  # by file


class Decided(NamedTuple):
    """What is known of the edges near the samples.

    Args:
        rig: with the phases fixed that put the edges of a test on the samples.
        x: coordinates from which to fit it, of the model before, shape (P,).
    """

    rig: Rig
    x: Float[np.ndarray, " P"]


class _Phase(NamedTuple):
    """The phase of one test whose edges come near the samples.

    Args:
        test: whose.
        index: of its coordinate.
        side: sign of phases inside the interval; 0 where edges are seen on both sides of their samples.
    """

    test: str
    index: int
    side: float


def with_edges_on_samples(rig: Rig, reached: Reached, places: Places, settings: EdgesInStepSettings) -> Decided | None:
    """Which tests have their edges on the samples; None where none has, and the fit stands as it is.

    Args:
        rig: with the tests named whose edges are in step, see `edges_in_step`.
        reached: the end of its fit.
        places: of all edges, as seen without a common phase.
        settings: what counts as on a sample.
    """
    near = list(_near_a_sample(reached.problem, reached.x, settings))
    if not near:
        return None
    x, at = reached.x.copy(), [phase.index for phase in near]
    for phase in near:  # beyond the sample chi2 does not depend on the phase
        if phase.side and phase.side * x[phase.index] < _HAIR:
            x[phase.index] = phase.side * _HAIR
    here = local(reached.problem, x, reached.weighted)
    best, sd = (x + here.step)[at], np.sqrt(np.diag(here.covariance))[at]
    inside = np.array([phase.side * b if phase.side else abs(b) for phase, b in zip(near, best, strict=True)])
    sharp = (sd < settings.scatter) & (inside < settings.on_sample * sd)
    on = inside < (settings.in_company * sd if sharp.any() else 0.0)
    missed = ~on & (x[at] != reached.x[at])  # lower inside, and the descent had left the interval
    if not np.any(on | missed):
        return None
    x[at] = np.where(missed, best, x[at])
    sides = {phase.side for phase, yes in zip(near, sharp, strict=True) if yes}
    fixed = rig
    if len(sides) == 1 and 0.0 not in sides:
        between = {phase.test for phase, yes in zip(near, ~on & (sd < settings.scatter), strict=True) if yes}
        others = {f: each for f, each in places.items() if f.partition("/")[0] not in between}
        fixed = _in_company(rig, others, 0.0 if sides == {1.0} else 1.0, settings)
    return Decided(_on_samples(fixed, [phase.test for phase, yes in zip(near, on, strict=True) if yes]), x)


def accepts(places: Sequence[EdgePlace], turn: float, settings: EdgesInStepSettings) -> bool:
    """True where the edges of a test may all be on the samples: chi2 rises by no more than chance over its minimum for
    one share of all. Edges that tell too little to have a place of their own tell it together.

    Args:
        places: of its edges.
        turn: 0 or 1: the share at which they would be.
        settings: `in_company`, standard errors.
    """
    share = np.array([p.share for p in places])
    weight = 1.0 / np.hypot([p.sd for p in places], settings.scatter) ** 2
    if not weight.sum() > 0.0:
        return True
    return abs(float(np.average(share, weights=weight)) - turn) * weight.sum() ** 0.5 < settings.in_company


def _in_company(rig: Rig, places: Places, turn: float, settings: EdgesInStepSettings) -> Rig:
    """The rig with this turn for all edges of all tests that accept it, and their phase on the sample."""
    files = {m.file: m.test for m in rig.measurements if places.get(m.file)}
    tests = [test for test in dict.fromkeys(files.values())
             if accepts([p for f, t in files.items() if t == test for p in places[f]], turn, settings)]  # fmt: skip
    turned = tuple(
        replace(m, edge_turn=_all(turn, m, places[m.file], settings)) if files.get(m.file) in tests else m
        for m in rig.measurements
    )
    return _on_samples(replace(rig, measurements=turned), tests)


def _all(
    turn: float, measurement: Measurement, places: Sequence[EdgePlace], settings: EdgesInStepSettings
) -> Float[np.ndarray, " n-1"]:
    """This turn for every edge of a trace but those that plainly came elsewhere; NaN where there is none."""
    out = np.full(measurement.time.size - 1, np.nan)
    for edge in places:
        if abs(edge.share - turn) < settings.far * np.hypot(edge.sd, settings.scatter):
            out[edge.interval] = turn
    return out


def _on_samples(rig: Rig, tests: Sequence[str]) -> Rig:
    """The rig with the phases of these tests known."""
    effects = [EdgePhase.at(Place(test)) for test in tests]
    named = dict.fromkeys((*rig.config.effects, *(effect.name for effect in effects)))
    known = {symbol: Fixed(0.0) for effect in effects for symbol in effect.off or ()}
    config = replace(rig.config, effects=tuple(named), parameters={**rig.config.parameters, **known})
    return replace(rig, config=config)


def _near_a_sample(
    problem: EstimationProblem, x: Float[np.ndarray, " P"], settings: EdgesInStepSettings
) -> Iterator[_Phase]:
    """The free phases of the tests whose edges come near the samples."""
    free = problem.layout.free
    for test in dict.fromkeys(trace.test.name for trace in problem.batch.traces):
        symbol = f"{EdgePhase.kind}.{test}"
        if symbol in free and abs(x[free.index(symbol)]) < settings.border:
            turns = _turns(problem, test)
            late, early = bool(np.any(turns > 0.5)), bool(np.any(turns < 0.5))
            yield _Phase(test, free.index(symbol), float(early) - float(late))


def _turns(problem: EstimationProblem, test: str) -> Float[np.ndarray, " edges"]:
    """Of every edge of a test that is in step, 0 or 1."""
    inputs = [trace.input for trace in problem.batch.traces if trace.test.name == test]
    return np.concatenate([s.turn[s.in_step] for s in inputs if s is not None and s.turn is not None] or [np.empty(0)])
