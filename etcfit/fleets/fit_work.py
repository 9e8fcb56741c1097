"""The work of a fleet: read a unit where it lies, lay its rig.toml over what is common, fit it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..estimation.settings import FitSettings
from ..rig.reader import digests_of
from ..rig.toml import Toml
from .engine.work import AbstractWork, digest_of
from .folder import address_of, local_copy
from .unit import UnitResult

if TYPE_CHECKING:
    from .fitting import Fitted


@dataclass(frozen=True)
class FitWork(AbstractWork):
    """Each unit by its own measurements.

    Args:
        location: of the fleet, as every worker sees it.
        common: what their rigs have in common.
        about: where the fleet's units lie, SI by symbol, to start from; None where nobody knows yet. It is not in the
            digest: where a fit starts is no part of what it finds.
        settings: of the fits.
    """

    location: str
    common: Toml
    about: Mapping[str, float] | None = None
    settings: FitSettings = FitSettings()

    def prepare(self) -> None:
        """Imports, and the folder of compiled programs."""
        from ..backend import use_compilation_cache

        use_compilation_cache()
        from . import fitting  # noqa: F401

    def digest(self, unit: str) -> str:
        """Of the unit's files, what is common, and the settings."""
        with local_copy(self.location, unit) as folder:
            return digest_of(digests_of(folder), common=self.common.tables, settings=self.settings)

    def fit(self, unit: str) -> UnitResult:
        """What the unit's fit leaves behind."""
        with local_copy(self.location, unit) as folder:
            left = self.fitted(folder, unit).left
            here, there = str(folder), address_of(self.location, unit)
            return replace(left, warnings=tuple(each.replace(here, there) for each in left.warnings))

    def fitted(self, folder: Path, unit: str) -> Fitted:
        """The unit in this folder, read and fitted, with all its traces."""
        from ..rig.reader import read_folder
        from .fitting import fit_unit

        return fit_unit(read_folder(folder, self.common), unit, self.about, self.settings)
