"""Standard errors and 95 % intervals in SI, from the covariance of the coordinates. No other module computes them.

    stderr = |dvalue/dx| sqrt(C_ss),    ci95 = value(x -+ 1.96 sqrt(C_ss))

The interval is mapped from coordinates, where the fit is nearest to linear, so it never crosses a bound. Parameters of
a model that is far from its data are a `compromise`: they have no standard error, and the range from subsets of the
data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect, ChannelGain, ChannelOffset, GearRatio, Place, TimeScale
from ..problem.free_parameters import FreeParameters
from .agreement import Z_95
from .identifiability import WEAK
from .levenberg_marquardt import prior_information
from .result import Budget, FitResult

_TINY = 1e-30  # step into the complex plane


@dataclass(frozen=True)
class Interval:
    """A parameter and its uncertainty, SI."""

    value: float  # value at the optimum
    stderr: float | None  # standard error; None if the parameter is not estimated or not identifiable
    # low, high: 95 % interval, or None likewise; of a compromise the range from subsets of the data
    low: float | None
    high: float | None
    status: str  # "estimated", "fixed", "tied", "not identifiable" or "compromise"
    remark: str | None = None  # a further remark for the reader, or None

    @property
    def spread(self) -> float | None:
        """Standard error, or the one for which the range would be a 95 % interval; None without either.

        It determines only how many digits are printed.
        """
        if self.stderr is not None or self.low is None or self.high is None:
            return self.stderr
        return (self.high - self.low) / (2.0 * Z_95)

    @classmethod
    def bare(cls, value: float, status: str, remark: str | None = None) -> Interval:
        """A value without an interval."""
        return cls(value, None, None, None, status, remark)


def intervals(result: FitResult) -> dict[str, Interval]:
    """Every parameter by symbol, in the model's order, and the gear ratio N last.

    A tied parameter has the interval of the parameter that it equals, and its status if that is no estimate.
    """
    layout = result.free_parameters.layout
    free = dict(zip(layout.free, _free(result), strict=True))
    held = {symbol: Interval.bare(result.values[symbol], "fixed") for symbol in layout.held}
    known = free | held
    known |= {symbol: _tied(symbol, other, known[other]) for symbol, other in layout.ties}
    config = result.rig.config
    remark = None if config.gear_ratio_given else "assumed: rig.toml does not give it"
    gear_ratio = Interval.bare(float(config.gear_ratio), "fixed", remark)
    return {p.symbol: known[p.symbol] for p in layout.parameters} | {"N": gear_ratio}


@dataclass(frozen=True)
class Lump:
    """A combination of parameters that may be known although its parts are not."""

    unit: str  # SI unit
    meaning: str  # meaning, with the formula first
    # the combination as a function of the values (SI, by symbol) and the gear ratio
    formula: Callable[[Mapping[str, Any], float], Any]
    electric: bool = False  # whether it needs an electrical side


LUMPS: dict[str, Lump] = {
    "J_eq": Lump("kg*m2", "N^2 J_m + J_L, at the plate", lambda v, n: n**2 * v["J_m"] + v["J_L"]),
    "B_eq": Lump("N*m*s/rad", "N^2 B_m + B_L, at the plate", lambda v, n: n**2 * v["B_m"] + v["B_L"]),
    "V_PL": Lump("V", "T_PL R_a/(N K_m): preload, in volts", lambda v, n: v["T_PL"] * _per_torque(v, n), True),
    "V_f": Lump("V", "T_f R_a/(N K_m): dry friction, in volts", lambda v, n: v["T_f"] * _per_torque(v, n), True),
    "V_s": Lump("V/rad", "K_s R_a/(N K_m): stiffness, in volts", lambda v, n: v["K_s"] * _per_torque(v, n), True),
    "V_w": Lump(
        "V*s/rad",
        "B_eq R_a/(N K_m) + N K_b: speed, in volts",
        lambda v, n: (n**2 * v["B_m"] + v["B_L"]) * _per_torque(v, n) + n * v["K_b"],
        True,
    ),
}


def _per_torque(values: Mapping[str, Any], gear_ratio: float) -> Any:
    """R_a / (N K_m): volts that hold one N m at the plate."""
    return values["R_a"] / (gear_ratio * values["K_m"])


def lumped(result: FitResult) -> dict[str, Interval]:
    """Combinations of parameters, by the delta method: stderr = sqrt(g^T C g), g the gradient in coordinates.

    They are the sums of motor and load that act on the plate, and the torques that hold and brake the plate in volts at
    the terminals; the latter are known even if no current, and so no torque, was logged.
    """
    electric = any(trace.circuit for trace in result.problem.batch.traces)
    n, free_parameters = result.rig.config.gear_ratio, result.free_parameters
    gradients = _gradients(free_parameters, result.x, n)
    unknown = result.settings.identifiability.unknown_widened
    stated = {
        s: _combined(float(lump.formula(result.values, n)), gradient, result.covariance, unknown)
        for (s, lump), gradient in zip(LUMPS.items(), gradients, strict=True)
        if electric or not lump.electric
    }
    if result.compromise is None:
        return stated
    return {s: _ranged(result, LUMPS[s], g, stated[s]) for s, g in zip(LUMPS, gradients, strict=True) if s in stated}


def _ranged(result: FitResult, lump: Lump, gradient: np.ndarray, stated: Interval) -> Interval:
    """A combination of parameters that are a compromise: range over the subsets that determine it, gradient of all."""
    compromise, n, layout = result.compromise, result.rig.config.gear_ratio, result.free_parameters.layout
    if compromise is None or stated.low is None or stated.high is None:
        return stated
    values = [float(lump.formula(layout.values(x, result.free_parameters.held), n)) for x in compromise.points]
    sd = [math.sqrt(max(float(gradient @ c @ gradient), 0.0)) for c in compromise.covariances]
    determined = [(v, Z_95 * s) for v, s in zip(values, sd, strict=True) if s < WEAK * abs(v)]
    low, high = (
        min([stated.low, *(v - half for v, half in determined)]),
        max([stated.high, *(v + half for v, half in determined)]),
    )
    return replace(stated, stderr=None, low=low, high=high, status="compromise")


def _gradients(free_parameters: FreeParameters, x: np.ndarray, n: float) -> np.ndarray:
    """Gradients of every combination in coordinates, shape (len(LUMPS), P).

        df/dx_k = Im f(v + i h e_k) / h dv_k/dx_k

    Exact for so small an h: there is no difference, so no cancellation.
    """
    layout = free_parameters.layout
    slope = layout.numbers(x)[1]
    values: dict[str, Any] = layout.values(x, free_parameters.held)
    values |= {
        symbol: values[symbol] + 1j * _TINY * aside for symbol, aside in zip(layout.free, np.eye(x.size), strict=True)
    }
    values |= {symbol: values[other] for symbol, other in layout.ties}
    return np.array([np.imag(lump.formula(values, n)) / _TINY * slope for lump in LUMPS.values()])


def _free(result: FitResult) -> list[Interval]:
    """Intervals of the free parameters, in the order of x."""
    layout, x = result.free_parameters.layout, result.x
    sd = np.sqrt(np.maximum(np.diag(result.covariance), 0.0))
    slope = layout.numbers(x)[1]
    low, high, status = x - Z_95 * sd, x + Z_95 * sd, "estimated"
    if result.compromise is not None:
        most = WEAK * layout.reach(x)
        (low, high), status = result.compromise.ends(Z_95, low, high, most), "compromise"
    value = [float(result.values[symbol]) for symbol in layout.free]
    ends = (layout.numbers(end)[0].tolist() for end in (low, high))
    columns = zip(value, (np.abs(slope) * sd).tolist(), *ends, strict=True)
    return [_judged(result, k, Interval(*row, status=status)) for k, row in enumerate(columns)]


def _judged(result: FitResult, k: int, stated: Interval) -> Interval:
    """The interval of the k-th free parameter, with a remark at a bound, or without numbers if it is unknown."""
    layout, value = result.free_parameters.layout, stated.value
    domain = layout.parameter(layout.free[k]).domain
    remark = "at its bound" if domain.at_bound(value) else None
    if layout.free[k] in result.identifiability.lost:
        return Interval.bare(value, "not identifiable", remark)
    sd = _root(result.covariance[k, k])
    if sd is None:
        return Interval.bare(value, "estimated", "its standard error could not be computed")
    if sd > result.settings.identifiability.unknown_widened * layout.reach(result.x)[k]:
        return Interval.bare(value, "not identifiable", remark)  # widening removed all information
    return replace(stated, remark=remark, stderr=stated.stderr if stated.status == "estimated" else None)


def _tied(symbol: str, other: str, equal: Interval) -> Interval:
    """The interval of a parameter that equals another one."""
    if equal.status in ("not identifiable", "compromise"):
        return replace(equal, remark=f"{symbol} = {other}")
    return replace(equal, status="tied", remark=f"{symbol} = {other}")


def _combined(value: float, gradient: np.ndarray, covariance: np.ndarray, unknown: float) -> Interval:
    """The interval of a combination by the delta method; none if its relative standard error exceeds `unknown`."""
    if not gradient.any():
        return Interval.bare(value, "fixed")
    stderr = _root(float(gradient @ covariance @ gradient))
    if stderr is None or stderr > unknown * abs(value):
        return Interval.bare(value, "not identifiable")
    return Interval(value, stderr, value - Z_95 * stderr, value + Z_95 * stderr, "estimated")


def _root(variance: float) -> float | None:
    """Standard deviation; None if the variance is negative or not finite."""
    return math.sqrt(variance) if math.isfinite(variance) and variance >= 0.0 else None


# ---- The contribution of the instruments' stated accuracy to the intervals: a probe that is 1 % off is off in every
# trace.
#
# A scale or zero b with an unknown error of standard deviation s_b moves the estimate by
#
#     dx = -(J^T J)^-1 J^T c_b b,    c_b = dr/db        C_full = C + sum_b p_b p_b^T,    p_b = s_b dx/db
#
# The data do not determine b (otherwise it would be a free parameter), so it is not fitted but added to the intervals.
#
# Source: GUM (JCGM 100:2008), 4.3 and 5.1 (type B, law of propagation); Schmidt 1966 ("consider" covariance). Differs
# from source: no.


@dataclass(frozen=True)
class _Source:
    """One source of uncertainty."""

    words: str  # its name in words
    # values of effects of the rig for one standard deviation of it, SI
    moves: tuple[tuple[type[AbstractRigEffect], float], ...]


def with_accuracy(result: FitResult) -> FitResult:
    """The fit with intervals that include the accuracy in rig.toml's [accuracy]; the fit itself if none is stated."""
    sources = _sources(result)
    if not sources:
        return result
    moves = _moves(result, sources)
    budget = Budget(tuple(source.words for source in sources), moves, result.covariance)
    return replace(result, covariance=result.covariance + moves.T @ moves, budget=budget)


def _sources(result: FitResult) -> list[_Source]:
    """The sources that could affect the fitted traces."""
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
    """Each end of the position sensor alone: position = theta + e (upper - theta)/(upper - lower), and so on."""
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
    prior = prior_information(result.free_parameters.layout, result.x, weighted.prior_sd)
    by_effect = -np.linalg.solve(own.T @ own + prior, own.T @ theirs)
    turned_on = np.zeros((len(effects), len(sources)))
    for k, source in enumerate(sources):
        for effect, sd in source.moves:
            turned_on[effects.index(effect), k] = sd / parameters_of(effect)[0].domain.scale
    return (by_effect @ turned_on).T


def _with(free_parameters: FreeParameters, effects: tuple[type[AbstractRigEffect], ...]) -> FreeParameters:
    """Free parameters with those of the effects added at the end."""
    layout = free_parameters.layout
    more = tuple(parameters_of(effect)[0] for effect in effects)
    extended = replace(
        layout,
        types=(*layout.types, *effects),
        parameters=(*layout.parameters, *more),
        free=(*layout.free, *(p.symbol for p in more)),
    )
    return replace(free_parameters, layout=extended)
