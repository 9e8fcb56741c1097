"""A run folder as one process knows it: what one stage leaves is handed to the next in memory.

A folder is named long before a model of it is needed: what loads and saves models is imported when it does so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UsageError

if TYPE_CHECKING:
    from ..diagnosis.findings import Diagnosis
    from ..estimation.result import FitResult


class RunFolder:
    """RUN and the models in it; each is loaded once, or never where it was made here."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._fit: FitResult | None = None
        self._diagnosis: Diagnosis | None = None

    @classmethod
    def named(cls, run: Path | str | RunFolder) -> RunFolder:
        """A run folder by its path, or itself."""
        return run if isinstance(run, RunFolder) else cls(run)

    def fit(self) -> FitResult:
        """The fit in it."""
        from .state import load_fit

        self._fit = self._fit or load_fit(self.path)
        return self._fit

    def diagnosis(self) -> Diagnosis | None:
        """The diagnosis in it; None where none was made."""
        from .state import has_diagnosis, load_diagnosis

        if self._diagnosis is None and has_diagnosis(self.path):
            self._diagnosis = load_diagnosis(self.path)
            self._fit = self._diagnosis.before
        return self._diagnosis

    def final(self) -> FitResult:
        """The final model of the diagnosis, or the fit where none was made."""
        diagnosis = self.diagnosis()
        return self.fit() if diagnosis is None else diagnosis.after

    def refuse_other_model(self, result: FitResult) -> None:
        """Nothing made from one model may lie beside another, which would then show it as a result of its own.

        Args:
            result: what gains, a transfer function or a posterior were made from.
        Raises:
            UsageError: RUN is of a fleet, or its last model is another; or see `load_final`.
        """
        from .manifest import is_fleet, read_records
        from .state import is_same_model

        if is_fleet(self.path):
            raise UsageError(f"{self.path} is the run folder of a fleet, and this was made from one unit's fit. "
                             "Save it to another folder.")  # fmt: skip
        if "fit" in read_records(self.path) and not is_same_model(self.final(), result):
            raise UsageError(f"The model in {self.path} is not the one from which this was made, and would show it as "
                             f"a result of its own. Save it to another folder, or save its fit to {self.path} "
                             "first.")  # fmt: skip

    def keep_fit(self, result: FitResult, beside: Callable[[Path], None] | None = None) -> None:
        """Save a fit; see `save_fit`."""
        from .state import save_fit

        save_fit(self.path, result, beside)
        self._fit, self._diagnosis = result, None

    def keep_diagnosis(self, diagnosis: Diagnosis, beside: Callable[[Path], None] | None = None) -> None:
        """Save a diagnosis; see `save_diagnosis`."""
        from .state import save_diagnosis

        save_diagnosis(self.path, diagnosis, beside)
        self._fit, self._diagnosis = diagnosis.before, diagnosis
