"""A unit of a fleet with a run folder and a page of its own, made where the fleet's workers are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..fleets.engine.cluster import Crew
from ..fleets.engine.run import run_units
from ..fleets.engine.store import Store
from ..fleets.engine.work import AbstractWork
from ..fleets.fitting import FitWork
from ..fleets.unit import UnitResult

FOLDER = "units"  # below the run folder of the fleet


@dataclass(frozen=True)
class PageWork(AbstractWork):
    """The unit fitted once more, saved whole, its pictures and its page.

    Args:
        fits: how units are read and fitted.
        run: the run folder of the fleet, as every worker sees it.
    """

    fits: FitWork
    run: str

    def prepare(self) -> None:
        """Imports, the folder of compiled programs, and pictures without a screen."""
        import matplotlib

        matplotlib.use("agg")
        self.fits.prepare()

    def digest(self, unit: str) -> str:
        """That of the fit; another where the page is gone."""
        here = "" if page_of(Path(self.run), unit).is_file() else " without a page"
        return self.fits.digest(unit) + here

    def fit(self, unit: str) -> UnitResult:
        """The unit's result, the same as before; its files are what counts."""
        from ..fleets.folder import local_copy
        from ..run_folder import RunFolder
        from .saving import keep_fit, keep_page

        with local_copy(self.fits.location, unit) as folder:
            fitted = self.fits.fitted(folder, unit)
            own = RunFolder(Path(self.run) / FOLDER / unit)
            keep_fit(own, fitted.result)
            keep_page(own)
        return replace(fitted.left, digest="")


def page_of(run: Path, unit: str) -> Path:
    """Where a unit's page lies."""
    return run / FOLDER / unit / "report.html"


def write_unit_pages(
    units: Sequence[str], fits: FitWork, run: Path, crew: Crew, report: Callable[[str, float], None]
) -> dict[str, str]:
    """A page for each of these units; what is there and still holds is not made again.

    Returns:
        unit -> its page, below the run folder; without those whose page could not be made.
    """
    parts = run / "parts" / "pages"
    with Store(parts) as store:
        work = PageWork(fits, str(run.absolute()))
        run_units(units, work, crew, store, lambda _, share: report("pages of odd units", share))
    pages = {unit: page_of(run, unit) for unit in units}
    return {unit: page.relative_to(run).as_posix() for unit, page in pages.items() if page.is_file()}
