"""Edges exactly on the samples: whether the edges of a test lie on a sample or between two is decided, not estimated.

    z = inside / sd,    inside = how far from its sample towards the begin (turn 1) or the end (turn 0) of its interval

A fixed-step simulation, or a loop that writes and samples in one tick, jumps at the sample instants themselves. There
the phase is at the end of its interval and the likelihood has one side: no gradient vanishes, and no interval is right.
So it is a question of two answers for each test, by likelihood: the phase is taken from the free set where chi2 is
lowest at the sample, or lower inside by no more than chance; elsewhere it stays free.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.rig_effects import EdgePhase, Place
from ..problem.problem import EstimationProblem
from ..rig.base import Fixed, Rig
from .levenberg_marquardt import local
from .rounds import Reached
from .settings import EdgesInStepSettings

_HAIR = 1e-5  # intervals; so near a sample the likelihood is looked at from inside


class _Phase(NamedTuple):
    """The phase of one test whose edges come near the samples.

    Args:
        symbol: of the parameter.
        index: of its coordinate.
        side: sign of phases inside the interval; 0 where edges are seen on both sides of their samples.
    """

    symbol: str
    index: int
    side: float


class Decided(NamedTuple):
    """What is known of the edges near the samples.

    Args:
        rig: with the phases fixed that put the edges of a test on the samples.
        x: coordinates from which to fit it, of the model before, shape (P,).
    """

    rig: Rig
    x: Float[np.ndarray, " P"]


def with_edges_on_samples(rig: Rig, reached: Reached, settings: EdgesInStepSettings) -> Decided | None:
    """Which tests have their edges on the samples; None where none has, and the fit stands as it is.

    Args:
        rig: with the tests named whose edges are in step, see `with_edges_in_step`.
        reached: the end of its fit.
        settings: what counts as on a sample.
    """
    near = list(_near_a_sample(reached.problem, reached.x, settings))
    if not near:
        return None
    x = reached.x.copy()
    for phase in near:  # beyond the sample chi2 does not depend on the phase
        if phase.side and phase.side * x[phase.index] < _HAIR:
            x[phase.index] = phase.side * _HAIR
    here = local(reached.problem, x, reached.weighted)
    at = [phase.index for phase in near]
    best, sd = (x + here.step)[at], np.sqrt(np.diag(here.covariance))[at]
    inside = np.array([phase.side * b if phase.side else abs(b) for phase, b in zip(near, best, strict=True)])
    on = on_samples(inside, sd, settings)
    missed = ~on & (x[at] != reached.x[at])  # lower inside, and the descent had left the interval
    if not np.any(on | missed):
        return None
    x[at] = np.where(missed, best, x[at])
    known = {phase.symbol: Fixed(0.0) for phase, yes in zip(near, on, strict=True) if yes}
    return Decided(replace(rig, config=replace(rig.config, parameters={**rig.config.parameters, **known})), x)


def on_samples(
    inside: Float[np.ndarray, " K"], sd: Float[np.ndarray, " K"], settings: EdgesInStepSettings
) -> np.ndarray:
    """Which tests have their edges on the samples, shape (K,).

    One whose phase is sharp tells by itself. Where one does, the clock is such a one: then every test whose phase may
    lie there does. Where none does, only those that are lowest at the sample.

    Args:
        inside: the likeliest phases, from the sample into the interval, sample intervals; below 0 where chi2 falls
            towards the sample all the way.
        sd: their standard deviations.
        settings: `scatter`, `on_sample` and `in_company`.
    """
    certain = (sd < settings.scatter) & (inside < settings.on_sample * sd)
    return inside < (settings.in_company * sd if certain.any() else 0.0)


def _near_a_sample(
    problem: EstimationProblem, x: Float[np.ndarray, " P"], settings: EdgesInStepSettings
) -> Iterator[_Phase]:
    """The free phases of the tests whose edges come near the samples."""
    free = problem.layout.free
    for test in dict.fromkeys(trace.test.name for trace in problem.batch.traces):
        (symbol,) = EdgePhase.at(Place(test)).off or ()
        if symbol in free and abs(x[free.index(symbol)]) < settings.border:
            turns = _turns(problem, test)
            late, early = bool(np.any(turns > 0.5)), bool(np.any(turns < 0.5))
            yield _Phase(symbol, free.index(symbol), float(early) - float(late))


def _turns(problem: EstimationProblem, test: str) -> Float[np.ndarray, " edges"]:
    """Of every edge of a test that is in step, 0 or 1."""
    inputs = [trace.input for trace in problem.batch.traces if trace.test.name == test]
    return np.concatenate([s.turn[s.in_step] for s in inputs if s is not None and s.turn is not None] or [np.empty(0)])
