"""All units of a fleet, fitted: a few from their own readings, all others from where those lie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import MeasurementError
from .config import FleetConfig
from .engine.cluster import Crew
from .engine.run import Tally, run_units
from .engine.settings import EngineSettings
from .engine.store import Store
from .fit_work import FitWork
from .unit import FailedUnit, UnitResult

PILOTS = (
    6  # units that are fitted before anybody knows where the fleet lies; more are tried where none of them is sound
)
_SOUND = 2.0  # chi2 per degree of freedom up to which a pilot's parameters are a start for others


@dataclass(frozen=True, eq=False)
class Results:
    """What is known of a fleet's units.

    Args:
        fitted: in the order of the fleet.
        failed: likewise.
        tally: of this run.
        work: how they were fitted.
        remark: what of the results that were stored could not be used, or "".
    """

    fitted: tuple[UnitResult, ...]
    failed: tuple[FailedUnit, ...]
    tally: Tally
    work: FitWork
    remark: str = ""


def fit_all(
    config: FleetConfig,
    crew: Crew,
    parts: Path,
    report: Callable[[str, float], None],
    settings: EngineSettings = EngineSettings(),
) -> Results:
    """Fit every unit whose stored result no longer holds.

    Args:
        config: of the fleet.
        crew: the workers.
        parts: folder of the store; made where it is not there.
        report: progress.
        settings: of the engine.
    Raises:
        MeasurementError: not one unit could be fitted.
    """
    work = FitWork(config.location, config.common)
    with Store(parts) as store:
        pilots = _spread(config.units, PILOTS)
        first = run_units(pilots, work, crew, store, report, settings)
        work = replace(work, about=_middle(store, pilots))
        others = tuple(unit for unit in config.units if unit not in pilots)
        tally = first.plus(run_units(others, work, crew, store, report, settings))
        ends = {end.unit: end for end in store.ends(config.units)}
    known = [ends[unit] for unit in config.units if unit in ends]
    fitted = tuple(end for end in known if isinstance(end, UnitResult))
    failed = tuple(end for end in known if isinstance(end, FailedUnit))
    if not fitted:
        raise MeasurementError(config.location, f"none of {len(config.units)} units could be fitted.",
                               "At least one must be.", f"The first says: {failed[0].why}")  # fmt: skip
    return Results(fitted, failed, tally, work, store.remark)


def _spread(units: tuple[str, ...], count: int) -> tuple[str, ...]:
    """So many of them, evenly over their order: the first ones of a day may have more in common than with the rest."""
    places = np.unique(np.linspace(0, len(units) - 1, min(count, len(units))).round().astype(int))
    return tuple(units[k] for k in places.tolist())


def _middle(store: Store, units: Sequence[str]) -> dict[str, float] | None:
    """Median of each parameter over these units, SI; None where none of them is sound."""
    found = [end for end in store.ends(units) if isinstance(end, UnitResult)]
    sound = [end for end in found if end.converged and end.chi2_per_dof < _SOUND]
    symbols = {symbol for end in sound for symbol in end.parameters}
    return {
        symbol: float(np.median([end.parameters[symbol].value for end in sound if symbol in end.parameters]))
        for symbol in sorted(symbols)
    } or None
