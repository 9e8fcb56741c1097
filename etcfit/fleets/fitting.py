"""Fits the units of a fleet: a few from their own readings, all others from the median of those; and their results.

    chi2(theta) ~ chi2(theta_0) + 2 g^T (theta - theta_0) + (theta - theta_0)^T F (theta - theta_0)
    estimate = theta_0 - F^+ g,    information = F

theta: the free parameters, SI; F = J^T J and g = J^T r of the whitened residual at the optimum, J near it where the
optimum is on a bound. The user's priors are not included: a prior that all units share would be counted with each unit.
The widening of the fit's intervals is not included either: from a handful of traces it cannot be estimated whether they
disagree; from the traces of many units it can, see `statistics.stack.robust`.

Motor and plate turn together: most rigs determine the sums N^2 J_m + J_L and N^2 B_m + B_L, but not their parts. The
sums replace the motor's part, so that each determined quantity has a symbol.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import MeasurementError
from ..estimation.fitted_model import SUMS
from ..estimation.intervals import LUMPS, intervals, lumped
from ..estimation.joint_fit import fit
from ..estimation.levenberg_marquardt import prior_information
from ..estimation.result import FitResult
from ..estimation.settings import FitSettings
from ..problem.free_parameters import SERIES, Layout
from ..rig.base import Rig
from ..rig.reader import digests_of
from ..rig.toml import Toml
from .config import FleetConfig
from .engine.cluster import Crew
from .engine.run import run_units
from .engine.store import Store
from .folder import address_of, local_copy
from .unit import AbstractWork, FailedUnit, TraceMisfit, UnitEstimate, UnitParameter, UnitResult, digest_of

PILOTS = 6  # units fitted from their own readings, whose median is the start of the others
SOUND = 2.0  # chi2 per degree of freedom up to which the parameters of a pilot serve as a start for others
OPEN = 1.0  # standard deviation over reach above which a direction counts as not determined: no quadratic holds so far


@dataclass(frozen=True, eq=False)
class Results:
    """The results of a fleet's units."""

    # fitted, failed: in the order of the fleet
    fitted: tuple[UnitResult, ...]
    failed: tuple[FailedUnit, ...]
    work: FitWork  # the work that fitted them
    remark: str = ""  # which stored results could not be used, or ""


def fit_all(config: FleetConfig, crew: Crew, parts: Path, report: Callable[[str, float], None]) -> Results:
    """Fit every unit whose result, stored in the folder `parts`, no longer holds.

    Raises:
        MeasurementError: not one unit could be fitted.
    """
    units, work = config.units, FitWork(config.location, config.common)
    # evenly over the order: the first units of a day may be more alike than the rest
    places = np.unique(np.linspace(0, len(units) - 1, min(PILOTS, len(units))).round().astype(int))
    pilots = [units[k] for k in places.tolist()]
    with Store(parts) as store:
        run_units(pilots, work, crew, store, report)
        work = replace(work, about=_middle(store, pilots))
        run_units([unit for unit in units if unit not in pilots], work, crew, store, report)
        ends = {end.unit: end for end in store.ends(units)}
    known = [ends[unit] for unit in units if unit in ends]
    fitted = tuple(end for end in known if isinstance(end, UnitResult))
    failed = tuple(end for end in known if isinstance(end, FailedUnit))
    if not fitted:
        raise MeasurementError(config.location, f"none of {len(units)} units could be fitted.",
                               "At least one must be.", f"Error of the first: {failed[0].why}")  # fmt: skip
    return Results(fitted, failed, work, store.remark)


def _middle(store: Store, units: Sequence[str]) -> dict[str, float] | None:
    """Median of each parameter over these units, SI; None where none of them is sound."""
    found = [end for end in store.ends(units) if isinstance(end, UnitResult)]
    sound = [end for end in found if end.converged and end.chi2_per_dof < SOUND]
    symbols = {symbol for end in sound for symbol in end.parameters}
    return {
        symbol: float(np.median([end.parameters[symbol].value for end in sound if symbol in end.parameters]))
        for symbol in sorted(symbols)
    } or None


@dataclass(frozen=True)
class FitWork(AbstractWork):
    """The work of a fleet: read a unit in its place, merge its rig.toml over the common tables, fit it."""

    location: str  # folder or address of the fleet, as every worker sees it
    common: Toml  # tables of a rig.toml that hold for all units
    # start of the fits: medians of the pilots, SI by symbol; None while they are unknown. It is not in the digest,
    # because the result of a fit does not depend on its start.
    about: Mapping[str, float] | None = None
    settings: FitSettings = FitSettings()  # of the fits

    def prepare(self) -> None:
        """Set the folder of compiled programs."""
        from ..backend import use_compilation_cache

        use_compilation_cache()

    def digest(self, unit: str) -> str:
        """Digest of the unit's files, the common tables, and the settings."""
        with local_copy(self.location, unit) as folder:
            return digest_of(digests_of(folder), common=self.common.tables, settings=self.settings)

    def fit(self, unit: str) -> UnitResult:
        """The result of the unit's fit."""
        with local_copy(self.location, unit) as folder:
            left = self.fitted(folder, unit).left
            here, there = str(folder), address_of(self.location, unit)
            return replace(left, warnings=tuple(each.replace(here, there) for each in left.warnings))

    def fitted(self, folder: Path, unit: str) -> Fitted:
        """The unit in this folder, read and fitted, with all its traces."""
        from ..rig.reader import read_folder

        return fit_unit(read_folder(folder, self.common), unit, self.about, self.settings)


class Fitted(NamedTuple):
    """A unit's full fit, and the result that is stored."""

    result: FitResult
    left: UnitResult


def fit_unit(
    rig: Rig, unit: str, about: Mapping[str, float] | None = None, settings: FitSettings = FitSettings()
) -> Fitted:
    """Fit one unit, starting at the medians of the fleet (`about`, SI by symbol) if they are known.

    Raises:
        MeasurementError: there is nothing to fit, or rig.toml names something that does not exist.
    """
    began = time.perf_counter()
    result = fit(rig, settings=settings, about=about)
    own, widening = own_estimate(result, unit)
    layout = result.free_parameters.layout
    declared = {p.symbol: p.unit for p in layout.parameters}
    known = {symbol: (interval, declared.get(symbol, "1")) for symbol, interval in intervals(result).items()}
    sums = {whole for motor, (whole, plate) in SUMS.items() if motor in layout.free and plate in layout.free}
    known |= {symbol: (each, LUMPS[symbol].unit) for symbol, each in lumped(result).items() if symbol in sums}
    left = UnitResult(
        own=own,
        parameters={
            symbol: UnitParameter(each.value, unit_of_measure, each.stderr, each.low, each.high, each.status)
            for symbol, (each, unit_of_measure) in known.items()
        },
        traces=tuple(
            TraceMisfit(trace.measurement.file, trace.measurement.test, float(np.sqrt(np.nanmean(r**2))))
            for trace, r in zip(result.problem.batch.traces, result.whitened, strict=True)
        ),
        chi2_per_dof=float(result.chi2_per_dof),
        converged=result.converged,
        reason=result.reason,
        synthetic=result.rig.config.synthetic,
        digest="",  # the engine knows it
        seconds=time.perf_counter() - began,
        warnings=tuple(result.warnings),
        widening=widening,
    )
    return Fitted(result, left)


def own_estimate(result: FitResult, unit: str) -> tuple[UnitEstimate, dict[str, float]]:
    """The unit's data as a quadratic in its free parameters, see the head of this file; and, by symbol, the factor by
    which the standard error that the fit states is wider."""
    layout = result.free_parameters.layout
    every, to_sums = _with_sums(layout, result.rig.config.gear_ratio)
    x = _off_bounds(result, every, to_sums)
    here = result.problem.linearise(result.x, result.weighted)
    there = here if np.array_equal(x, result.x) else result.problem.linearise(x, result.weighted)
    value, slope = layout.numbers(result.x)[0], layout.numbers(x)[1]
    size = np.abs(to_sums) @ (slope * layout.reach(x))  # change of each when the coordinates change by their reach
    forth = to_sums * slope / size[:, None]  # from coordinates to parameters over their size
    jacobian = there.jacobian.reshape(-1, x.size) @ np.linalg.inv(forth)
    eigenvalues, ways = np.linalg.eigh(jacobian.T @ jacobian)
    eigenvalues = np.where(eigenvalues > OPEN**-2, eigenvalues, 0.0)
    information = (ways * eigenvalues) @ ways.T
    step = np.linalg.pinv(information, rcond=1e-12, hermitian=True) @ (jacobian.T @ here.r.ravel())
    estimate = to_sums @ value - size * step
    told_alone = np.diag(information) > OPEN**-2
    kept = [k for k, symbol in enumerate(every) if told_alone[k] and not symbol.startswith(SERIES)]
    own = _marginal(information, kept) / np.outer(size[kept], size[kept])
    wider = _widened(result, here.jacobian.reshape(-1, x.size), to_sums)[kept]
    symbols = tuple(every[k] for k in kept)
    return UnitEstimate(unit, symbols, estimate[kept], own), dict(zip(symbols, wider.tolist(), strict=True))


def _off_bounds(result: FitResult, every: list[str], to_sums: np.ndarray) -> Float[np.ndarray, " P"]:
    """Coordinates off their bounds, so that a change of each changes the model, near the optimum, shape (P,).

    Where a part of a sum is moved off its bound, the other part is reduced by as much, so that the sum stays the same.
    """
    layout = result.free_parameters.layout
    x = layout.off_bounds(result.x)
    if np.array_equal(x, result.x):
        return x
    before, after = layout.numbers(result.x)[0], layout.numbers(x)[0]
    change = to_sums @ (after - before)
    values = dict(zip(layout.free, after.tolist(), strict=True))
    for motor, (whole, plate) in SUMS.items():
        if whole in every:
            k, squared = every.index(whole), result.rig.config.gear_ratio**2
            at = layout.free.index(plate)
            if after[at] == before[at]:
                values[plate] -= change[k]
            else:
                values[motor] -= change[k] / squared
    kept = [s for s, value in values.items() if layout.parameter(s).domain.inside(value) == value]
    return np.where([s in kept for s in layout.free], layout.coordinates(values), x)


def _widened(result: FitResult, jacobian: np.ndarray, to_sums: np.ndarray) -> Float[np.ndarray, " P"]:
    """Factor by which the stated standard errors of the parameters exceed the plain ones, at least 1, shape (P,);
    the Jacobian is that of the coordinates, shape (n, P)."""
    layout, prior_sd = result.problem.layout, np.asarray(result.weighted.prior_sd)
    plain = np.linalg.inv(jacobian.T @ jacobian + prior_information(layout, result.x, prior_sd))
    turn = to_sums * layout.numbers(result.x)[1]
    stated, least = (np.einsum("ij,jk,ik->i", turn, c, turn) for c in (result.stated_covariance, plain))
    return np.sqrt(np.maximum(1.0, stated / np.maximum(least, 1e-300)))


def _with_sums(layout: Layout, gear_ratio: float) -> tuple[list[str], Float[np.ndarray, "P P"]]:
    """Symbols with sums in place of motors' parts, and the matrix from the free parameters to them."""
    symbols, forth = list(layout.free), np.eye(len(layout.free))
    for motor, (whole, plate) in SUMS.items():
        if motor in layout.free and plate in layout.free:
            at, other = layout.free.index(motor), layout.free.index(plate)
            symbols[at] = whole
            forth[at, at], forth[at, other] = gear_ratio**2, 1.0
    return symbols, forth


def _marginal(information: Float[np.ndarray, "P P"], kept: list[int]) -> Float[np.ndarray, "Q Q"]:
    """Information on some parameters, over their sizes, marginalised over the others."""
    left = [k for k in range(len(information)) if k not in kept]
    eigenvalues, ways = np.linalg.eigh(information[np.ix_(left, left)])
    across = information[np.ix_(kept, left)] @ ways[:, eigenvalues > OPEN**-2]
    return information[np.ix_(kept, kept)] - across / eigenvalues[eigenvalues > OPEN**-2] @ across.T
