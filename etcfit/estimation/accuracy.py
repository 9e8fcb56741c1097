"""What the stated accuracy of the instruments adds to the intervals: a probe that is 1 % off is so in every trace.

A scale or zero b that is off by an unknown amount of standard deviation s_b moves the estimate by

    dx = -(J^T J)^-1 J^T c_b b,    c_b = dr/db        C_full = C + sum_b p_b p_b^T,    p_b = s_b dx/db

The data cannot tell b (or the fit would have been asked to); so it is not fitted but carried into the intervals.

Source: GUM (JCGM 100:2008), 4.3 and 5.1 (type B, law of propagation); Schmidt 1966 ("consider" covariance). Differs
from source: no.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect, ChannelGain, ChannelOffset, GearRatio, Place
from ..problem.free_parameters import FreeParameters
from ..rig.base import RigConfig
from .budget import Budget
from .identifiability import WIDE
from .result import FitResult

_RECTANGULAR = math.sqrt(3.0)  # limit over standard deviation


@dataclass(frozen=True)
class _Source:
    """One thing that may be off: the effect that it is, and its standard deviation, SI."""

    words: str
    effect: type[AbstractRigEffect]
    sd: float


def with_accuracy(result: FitResult) -> FitResult:
    """The fit with intervals that allow for what rig.toml's [accuracy] states; the fit itself where it states none."""
    sources = _sources(result.rig.config, result)
    if not sources:
        return result
    moves = _moves(result, sources)
    budget = Budget(tuple(source.words for source in sources), moves, result.covariance)
    return replace(result, covariance=result.covariance + moves.T @ moves, budget=budget)


def _sources(config: RigConfig, result: FitResult) -> list[_Source]:
    """Those that the traces fitted could feel."""
    traces = result.problem.batch.traces
    logged = {channel for trace in traces for channel in trace.channels}
    logged |= {"voltage"} if any(t.circuit and t.input is not None for t in traces) else set()
    found = []
    for channel, accuracy in config.accuracy.items():
        if channel == "gear":
            found.append(_Source("gear ratio", GearRatio.at(Place()), accuracy.relative / _RECTANGULAR))
        elif channel in logged:
            kinds = (("scale", ChannelGain, accuracy.relative), ("zero", ChannelOffset, accuracy.absolute))
            for words, family, limit in kinds:
                effect = family.at(Place("", channel))
                found.append(_Source(f"{words} of {channel}", effect, limit / _RECTANGULAR))
    at_work = result.free_parameters.layout.types
    return [source for source in found if source.sd > 0.0 and source.effect not in at_work]


def _moves(result: FitResult, sources: list[_Source]) -> np.ndarray:
    """p_b of every source, shape (S, P)."""
    known = _with(result.free_parameters, sources)
    problem = result.problem.with_parameters(known)
    x = np.concatenate((result.x, np.zeros(len(sources))))
    weighted = problem.weighted(result.weighted.whitening)
    jacobian = problem.linearise(x, weighted)[2]
    flat, size = jacobian.reshape(-1, x.size), result.x.size
    own, theirs = flat[:, :size], flat[:, size:]
    reach = result.free_parameters.layout.reach(result.x)
    prior = 1.0 / (WIDE * reach) ** 2 + 1.0 / np.asarray(weighted.prior_sd)[:size] ** 2
    scale = [source.sd / parameters_of(source.effect)[0].domain.scale for source in sources]
    return -np.linalg.solve(own.T @ own + np.diag(prior), own.T @ theirs).T * np.array(scale)[:, None]


def _with(free_parameters: FreeParameters, sources: list[_Source]) -> FreeParameters:
    """The sources' parameters free, after all others."""
    layout = free_parameters.layout
    effects = tuple(source.effect for source in sources)
    more = tuple(parameters_of(effect)[0] for effect in effects)
    extended = replace(
        layout,
        types=(*layout.types, *effects),
        parameters=(*layout.parameters, *more),
        free=(*layout.free, *(p.symbol for p in more)),
    )
    return replace(free_parameters, layout=extended)
