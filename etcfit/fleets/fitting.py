"""One unit of a fleet, fitted: from its folder to what it leaves behind.

    chi2(theta) ~ chi2(theta_0) + 2 g^T (theta - theta_0) + (theta - theta_0)^T F (theta - theta_0)
    estimate = theta_0 - F^+ g,    information = F

theta: the free parameters, SI; F = J^T J and g = J^T r of the whitened residual at the optimum, J beside it where it
lies on a bound. The user's priors are not in it: one that all units share would be counted as often as there are units.
Nor is what the fit widens its intervals by: of a handful of traces nobody can tell whether they disagree; of the traces
of many units one can, see `statistics.stack.robust`.

Motor and plate turn together: a rig mostly tells N^2 J_m + J_L and N^2 B_m + B_L, and of each sum's parts nothing. The
sums take the place of the motor's part, so that what is told has a symbol of its own.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..estimation.fitted_model import SUMS
from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import fit
from ..estimation.levenberg_marquardt import believed
from ..estimation.result import FitResult
from ..estimation.settings import FitSettings
from ..problem.free_parameters import SERIES, Layout
from ..rig.base import Rig
from .unit import TraceMisfit, UnitEstimate, UnitParameter, UnitResult

_OPEN = 1.0  # standard deviation over reach from which on a direction is taken as not told: no quadratic holds so far


class Fitted(NamedTuple):
    """A unit's fit in full, and what it leaves behind.

    Args:
        result: with all traces.
        left: without.
    """

    result: FitResult
    left: UnitResult


def fit_unit(
    rig: Rig, unit: str, about: Mapping[str, float] | None = None, settings: FitSettings = FitSettings()
) -> Fitted:
    """Fit one unit.

    Args:
        rig: its measurements.
        unit: its name.
        about: where the fleet's units lie, SI by symbol, to start from; None where nobody knows yet.
        settings: of the fit.
    Raises:
        MeasurementError: nothing to fit, or what rig.toml names does not exist.
    """
    began = time.perf_counter()
    result = fit(rig, settings=settings, about=about)
    return Fitted(result, left_behind(result, unit, time.perf_counter() - began))


def left_behind(result: FitResult, unit: str, seconds: float) -> UnitResult:
    """What a fit that took so many seconds leaves behind."""
    declared = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    sums = {symbol: interval for symbol, interval in lumped(result).items() if symbol in _sums_of(result)}
    every = {symbol: (interval, declared.get(symbol, "1")) for symbol, interval in intervals(result).items()}
    every |= {symbol: (interval, LUMPS[symbol].unit) for symbol, interval in sums.items()}
    own = own_estimate(result, unit)
    return UnitResult(
        own=own.estimate,
        parameters={symbol: _parameter(*known) for symbol, known in every.items()},
        traces=tuple(
            TraceMisfit(trace.measurement.file, trace.measurement.test, float(np.sqrt(np.nanmean(r**2))))
            for trace, r in zip(result.problem.batch.traces, result.whitened, strict=True)
        ),
        chi2_per_dof=float(result.chi2_per_dof),
        converged=result.converged,
        reason=result.reason,
        synthetic=result.rig.config.synthetic,
        digest="",  # the engine knows it
        seconds=seconds,
        warnings=tuple(result.warnings),
        widening=own.widening,
    )


def _parameter(interval: Interval, unit: str) -> UnitParameter:
    return UnitParameter(interval.value, unit, interval.stderr, interval.low, interval.high, interval.status)


def _sums_of(result: FitResult) -> tuple[str, ...]:
    free = result.free_parameters.layout.free
    return tuple(whole for motor, (whole, plate) in SUMS.items() if motor in free and plate in free)


class Own(NamedTuple):
    """What a unit's own data tell.

    Args:
        estimate: as a quadratic.
        widening: by symbol, how many times wider the standard error is that the fit states.
    """

    estimate: UnitEstimate
    widening: dict[str, float]


def own_estimate(result: FitResult, unit: str) -> Own:
    """The unit's data as a quadratic in its free parameters, see the head of this file."""
    layout = result.free_parameters.layout
    into = _with_sums(layout, result.rig.config.gear_ratio)
    x = _off_bounds(result, into)
    here = result.problem.linearise(result.x, result.weighted)
    there = here if np.array_equal(x, result.x) else result.problem.linearise(x, result.weighted)
    value, slope = layout.numbers(result.x)[0], layout.numbers(x)[1]
    size = np.abs(into.forth) @ (slope * layout.reach(x))  # by how much each changes where coordinates go their reach
    forth = into.forth * slope / size[:, None]  # from coordinates to parameters over their size
    jacobian = there.jacobian.reshape(-1, x.size) @ np.linalg.inv(forth)
    told, ways = np.linalg.eigh(jacobian.T @ jacobian)
    told = np.where(told > _OPEN**-2, told, 0.0)
    information = (ways * told) @ ways.T
    step = np.linalg.pinv(information, rcond=1e-12, hermitian=True) @ (jacobian.T @ here.r.ravel())
    estimate = into.forth @ value - size * step
    told_alone = np.diag(information) > _OPEN**-2
    kept = [k for k, symbol in enumerate(into.symbols) if told_alone[k] and not symbol.startswith(SERIES)]
    own = _marginal(information, kept) / np.outer(size[kept], size[kept])
    wider = _widened(result, here.jacobian.reshape(-1, x.size), into.forth)[kept]
    symbols = tuple(into.symbols[k] for k in kept)
    return Own(UnitEstimate(unit, symbols, estimate[kept], own), dict(zip(symbols, wider.tolist(), strict=True)))


def _off_bounds(result: FitResult, into: _Sums) -> Float[np.ndarray, " P"]:
    """Coordinates at which a change of each changes the model, as near the optimum as may be, shape (P,).

    A part that is moved off its bound takes from the other what it gets, so that their sum stays as it was found.
    """
    layout = result.free_parameters.layout
    x = layout.off_bounds(result.x)
    if np.array_equal(x, result.x):
        return x
    before, after = layout.numbers(result.x)[0], layout.numbers(x)[0]
    change = into.forth @ (after - before)
    values = dict(zip(layout.free, after.tolist(), strict=True))
    for motor, (whole, plate) in SUMS.items():
        if whole in into.symbols:
            k, squared = into.symbols.index(whole), result.rig.config.gear_ratio**2
            at = layout.free.index(plate)
            if after[at] == before[at]:
                values[plate] -= change[k]
            else:
                values[motor] -= change[k] / squared
    kept = [s for s, value in values.items() if layout.parameter(s).domain.inside(value) == value]
    return np.where([s in kept for s in layout.free], layout.coordinates(values), x)


def _widened(result: FitResult, jacobian: np.ndarray, forth: np.ndarray) -> Float[np.ndarray, " P"]:
    """By how much the stated standard errors of the parameters are wider than the plain ones, at least 1, shape (P,).

    Args:
        result: the fit.
        jacobian: at the optimum, in the coordinates, shape (n, P).
        forth: from the values of the free parameters to the parameters, shape (P, P).
    """
    layout, prior_sd = result.problem.layout, np.asarray(result.weighted.prior_sd)
    plain = np.linalg.inv(jacobian.T @ jacobian + believed(layout, result.x, prior_sd))
    turn = forth * layout.numbers(result.x)[1]
    stated, least = (np.einsum("ij,jk,ik->i", turn, c, turn) for c in (result.stated_covariance, plain))
    return np.sqrt(np.maximum(1.0, stated / np.maximum(least, 1e-300)))


class _Sums(NamedTuple):
    """A linear change of the free parameters, p_new = forth p_old; `back` is its inverse."""

    symbols: tuple[str, ...]
    forth: Float[np.ndarray, "P P"]
    back: Float[np.ndarray, "P P"]


def _with_sums(layout: Layout, gear_ratio: float) -> _Sums:
    symbols, forth = list(layout.free), np.eye(len(layout.free))
    for motor, (whole, plate) in SUMS.items():
        if motor in layout.free and plate in layout.free:
            at, beside = layout.free.index(motor), layout.free.index(plate)
            symbols[at] = whole
            forth[at, at], forth[at, beside] = gear_ratio**2, 1.0
    return _Sums(tuple(symbols), forth, np.linalg.inv(forth))


def _marginal(information: Float[np.ndarray, "P P"], kept: list[int]) -> Float[np.ndarray, "Q Q"]:
    """Information on some parameters, over their sizes, when nothing is known of the others beyond the same data."""
    left = [k for k in range(len(information)) if k not in kept]
    told, ways = np.linalg.eigh(information[np.ix_(left, left)])
    across = information[np.ix_(kept, left)] @ ways[:, told > _OPEN**-2]
    return information[np.ix_(kept, kept)] - across / told[told > _OPEN**-2] @ across.T
