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
from ..model.rig_effects import AbstractRigEffect, ChannelGain, ChannelOffset, GearRatio, Place, TimeScale
from ..problem.free_parameters import FreeParameters
from .budget import Budget
from .levenberg_marquardt import believed
from .result import FitResult


@dataclass(frozen=True)
class _Source:
    """One thing that may be off.

    Args:
        words: what it is called.
        moves: by how much one standard deviation of it turns on effects of the rig, SI.
    """

    words: str
    moves: tuple[tuple[type[AbstractRigEffect], float], ...]


def with_accuracy(result: FitResult) -> FitResult:
    """The fit with intervals that allow for what rig.toml's [accuracy] states; the fit itself where it states none."""
    sources = _sources(result)
    if not sources:
        return result
    moves = _moves(result, sources)
    budget = Budget(tuple(source.words for source in sources), moves, result.covariance)
    return replace(result, covariance=result.covariance + moves.T @ moves, budget=budget)


def _sources(result: FitResult) -> list[_Source]:
    """Those that the traces fitted could feel."""
    config, traces = result.rig.config, result.problem.batch.traces
    logged = {channel for trace in traces for channel in trace.channels}
    driven = [trace for trace in traces if trace.input is not None]
    logged |= {"torque" if trace.torque_driven else "voltage" for trace in driven}
    lower, upper = config.travel
    found = []
    for key, accuracy in config.accuracy.items():
        gain, offset = (family.at(Place("", key)) for family in (ChannelGain, ChannelOffset))
        match key:
            case "gear":
                found.append(_Source("gear ratio", ((GearRatio.at(Place()), accuracy.gain_sd),)))
            case "time":
                found.append(_Source("clock", ((TimeScale.at(Place()), accuracy.gain_sd),)))
            case "sensor_end_points":
                if "position" in logged:
                    found += _end_points(lower, upper, accuracy.offset_sd)
            case _ if key in logged:
                found += [_Source(f"scale of {key}", ((gain, accuracy.gain_sd),))]
                found += [_Source(f"zero of {key}", ((offset, accuracy.offset_sd),))] if key != "torque" else []
    at_work = result.free_parameters.layout.types
    return [s for s in found if all(sd != 0.0 and effect not in at_work for effect, sd in s.moves)]


def _end_points(lower: float, upper: float, sd: float) -> list[_Source]:
    """Each end of the position sensor by itself: position = theta + e (upper - theta)/(upper - lower), and so on."""
    gain, offset = (family.at(Place("", "position")) for family in (ChannelGain, ChannelOffset))
    span = upper - lower
    if not math.isfinite(span):
        return [_Source("zero of position", ((offset, sd),))]
    return [
        _Source("closed end of the sensor", ((offset, sd * upper / span), (gain, -sd / span))),
        _Source("open end of the sensor", ((offset, -sd * lower / span), (gain, sd / span))),
    ]


def _moves(result: FitResult, sources: list[_Source]) -> np.ndarray:
    """p_b of every source, shape (S, P)."""
    effects = tuple(dict.fromkeys(effect for source in sources for effect, _ in source.moves))
    problem = result.problem.with_parameters(_with(result.free_parameters, effects))
    x = np.concatenate((result.x, np.zeros(len(effects))))
    weighted = problem.weighted(result.weighted.whitening)
    jacobian = problem.linearise(x, weighted).jacobian
    flat, size = jacobian.reshape(-1, x.size), result.x.size
    own, theirs = flat[:, :size], flat[:, size:]
    prior = believed(result.free_parameters.layout, result.x, weighted.prior_sd)
    by_effect = -np.linalg.solve(own.T @ own + prior, own.T @ theirs)
    turned_on = np.zeros((len(effects), len(sources)))
    for k, source in enumerate(sources):
        for effect, sd in source.moves:
            turned_on[effects.index(effect), k] = sd / parameters_of(effect)[0].domain.scale
    return (by_effect @ turned_on).T


def _with(free_parameters: FreeParameters, effects: tuple[type[AbstractRigEffect], ...]) -> FreeParameters:
    """The effects' parameters free, after all others."""
    layout = free_parameters.layout
    more = tuple(parameters_of(effect)[0] for effect in effects)
    extended = replace(
        layout,
        types=(*layout.types, *effects),
        parameters=(*layout.parameters, *more),
        free=(*layout.free, *(p.symbol for p in more)),
    )
    return replace(free_parameters, layout=extended)
