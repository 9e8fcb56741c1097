"""A fleet, from its folder to its page, and a page for each odd unit: shared by the command and the verb."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import MeasurementError
from ..files import held
from ..fleets.config import FleetConfig, read_fleet
from ..fleets.engine.cluster import Crew, ExistingScheduler, LocalWorkers, cores, crew, require_workers
from ..fleets.engine.run import run_units
from ..fleets.engine.store import Store
from ..fleets.fitting import FitWork, fit_all
from ..fleets.folder import local_copy, refuse_inside
from ..fleets.unit import AbstractWork, UnitResult
from ..rig.config import config_of
from ..rig.toml import Toml
from ..run_folder.commit import Draft, all_or_none, settle

if TYPE_CHECKING:
    from ..rig.base import RigConfig
    from ..run_folder.fleet import FleetFiles
    from .progress import Report

_PICTURES = "pictures/fleet"
MEMORY = 0.6  # share of this machine's memory that all workers together may use
LEAST_MEMORY = 1500 * 1024**2  # bytes of one worker: a compiled model, and space to compile the next


def workers(count: int | None, scheduler: str | None) -> LocalWorkers | ExistingScheduler:
    """The workers of a fleet."""
    if scheduler is not None:
        return ExistingScheduler(scheduler)
    number = cores() if count is None else count
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 8 * 1024**3
    return LocalWorkers(number, max(LEAST_MEMORY, min(LocalWorkers.memory, int(MEMORY * whole / number))))


def work_through(
    location: str | Path, run: Path, place: LocalWorkers | ExistingScheduler, report: Report, watch: Report
) -> tuple[FleetFiles, str]:
    """Fit every unit that has no current result, study all units together, and write the results.

    Args:
        watch: called with the address where the workers can be watched.
    Returns:
        The results, and which stored ones could not be used, or "".
    Raises:
        MeasurementError: there is no unit, fleet.toml or units.csv is wrong, or no unit could be fitted.
        UsageError: a library of the extra `fleet` is not installed, no worker answers, RUN lies in the fleet, or
            another process writes there.
    """
    from ..fleets.study import study
    from ..run_folder.fleet import read_fleet_files, save_fleet

    require_workers()
    refuse_inside(location, run)
    with held(run), ExitStack() as opened:
        # a missing scheduler is reported before anything else takes time
        hands = opened.enter_context(crew(place)) if isinstance(place, ExistingScheduler) else None
        report("reading the fleet", 0.0)
        config = read_fleet(location)
        toml = rig_of_one(config)
        rig = config_of(toml, "fleet")
        refuse_wrong_limits(config, rig)
        report("starting the workers", 0.0)
        hands = hands or opened.enter_context(crew(place))
        watch(hands.address, 0.0)
        results = fit_all(config, hands, run / "parts", report)
        report("studying all units together", 0.0)
        found = study(config, rig, results)
        pages = write_unit_pages([unit.unit for unit in found.odd], results.work, run, hands, report)
        with all_or_none(run) as draft:
            save_fleet(draft.files, found, toml, pages)
            files = read_fleet_files(draft.files)
            _draw(draft, files, report)
        settle(run)
        return files, results.remark


def show(run: Path, files: FleetFiles, report: Report) -> None:
    """Pictures and the page."""
    with held(run):
        with all_or_none(run) as draft:
            _draw(draft, files, report)
        settle(run)


def _draw(draft: Draft, files: FleetFiles, report: Report) -> None:
    from ..reporting.fleet.page import write_fleet_page
    from ..reporting.fleet.pictures import draw_fleet

    report("drawing", 0.5)
    draw_fleet(files.content, files.units, draft.files / _PICTURES)
    draft.alone(_PICTURES)
    report("writing the page", 0.9)
    write_fleet_page(draft.files, files.content, files.units)


def rig_of_one(config: FleetConfig) -> Toml:
    """rig.toml of the first unit with a valid one; those of the other units differ only in properties of the unit.

    Raises:
        MeasurementError: no unit has a valid one; the error of the first unit.
    """
    from ..rig.reader import rig_toml

    first: MeasurementError | None = None
    for unit in config.units:
        try:
            with local_copy(config.location, unit) as folder:
                toml = rig_toml(str(folder), config.common)
            config_of(toml, "fleet")
            return toml
        except MeasurementError as error:
            first = first or error
    assert first is not None, "a fleet has a unit"
    raise first


def refuse_wrong_limits(config: FleetConfig, rig: RigConfig) -> None:
    """Refuse, before hours of fits, a limit or a shared symbol that the model does not have, and a limit in the unit of
    another quantity, such as a spring's torque without its angle.
    """
    from ..estimation.intervals import LUMPS
    from ..fleets.line import FIGURE_BY_NAME
    from ..problem.free_parameters import free_parameters
    from ..rig.toml import closest, place_of

    layout, toml = free_parameters(rig).layout, config.common
    symbols = [*layout.free, *LUMPS]
    for table, names, known in (
        ("fleet.shared", config.shared, symbols),
        ("limits", config.limits, [*symbols, *FIGURE_BY_NAME]),
    ):
        if unknown := next((name for name in names if name not in known), None):
            where = place_of(toml.path, toml.source, table if table != "limits" else f"limits.{unknown}")
            raise MeasurementError(where, f"{table}: this fleet's model has no {unknown}.",
                                   f"Known: {', '.join(known)}.", closest(unknown, known, "Delete it."))  # fmt: skip
    units = {p.symbol: p.unit for p in layout.parameters}
    units |= {name: each.unit for table in (LUMPS, FIGURE_BY_NAME) for name, each in table.items()}
    for name, limit in config.limits.items():
        if not _comes_down_to(units[name], limit.unit):
            raise MeasurementError(place_of(toml.path, toml.source, f"limits.{name}"),
                                   f"limits.{name}: found unit '{limit.given}'.",
                                   f"{name} is in {units[name]}, or in a multiple of it.",
                                   f'Write unit = "{units[name]}", and the limits in it.')  # fmt: skip


def _comes_down_to(unit: str, base: str) -> bool:
    """Whether a unit is a multiple of that base unit; True for a unit that cannot be parsed."""
    from ..rig.units import UnitError, to_si

    try:
        return to_si(unit)[0] == base
    except UnitError:
        return True


FOLDER = "units"  # below the run folder of the fleet


@dataclass(frozen=True)
class PageWork(AbstractWork):
    """Fit a unit again, save the whole fit, and write its pictures and its page."""

    fits: FitWork  # how units are read and fitted
    run: str  # the run folder of the fleet, as every worker sees it

    def prepare(self) -> None:
        """Import modules, set the folder of compiled programs, and draw pictures without a screen."""
        import matplotlib

        matplotlib.use("agg")
        self.fits.prepare()

    def digest(self, unit: str) -> str:
        """The digest of the fit; another value if the page is missing."""
        here = "" if page_of(Path(self.run), unit).is_file() else " without a page"
        return self.fits.digest(unit) + here

    def fit(self, unit: str) -> UnitResult:
        """The unit's result, the same as before; the purpose is to write its files."""
        from ..run_folder.folder import RunFolder
        from .work import keep_fit, keep_page

        with local_copy(self.fits.location, unit) as folder:
            fitted = self.fits.fitted(folder, unit)
            own = RunFolder(Path(self.run) / FOLDER / unit)
            keep_fit(own, fitted.result)
            keep_page(own)
        return replace(fitted.left, digest="")


def page_of(run: Path, unit: str) -> Path:
    """Path of a unit's page."""
    return run / FOLDER / unit / "report.html"


def write_unit_pages(
    units: Sequence[str], fits: FitWork, run: Path, crew: Crew, report: Callable[[str, float], None]
) -> dict[str, str]:
    """Write a page for each of these units that has no current page.

    Returns:
        unit -> its page, below the run folder; without the units whose page could not be made.
    """
    parts = run / "parts" / "pages"
    with Store(parts) as store:
        work = PageWork(fits, str(run.absolute()))
        run_units(units, work, crew, store, lambda _, share: report("pages of odd units", share))
    pages = {unit: page_of(run, unit) for unit in units}
    return {unit: page.relative_to(run).as_posix() for unit, page in pages.items() if page.is_file()}
