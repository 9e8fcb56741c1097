"""Rounds of a diagnosis under way: written after each of them, so that one that was interrupted goes on from there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..diagnosis.rounds import Progress
from ..diagnosis.settings import DEFAULT, DiagnosisSettings
from ..errors import command
from ..estimation.identifiability import listed
from ..estimation.result import FitResult
from ..files import put_aside
from . import codec
from .manifest import DIAGNOSIS_ROUNDS, FIT_STATE, digest


@dataclass(frozen=True, eq=False)
class _Kept:
    """What the file holds.

    Args:
        fit: SHA-256 of the file of the fit that is diagnosed.
        settings: of the diagnosis.
        progress: the rounds, and the model after them.
    """

    fit: str | None
    settings: DiagnosisSettings
    progress: Progress


class KeptRounds:
    """RUN/diagnosis_rounds.npz, there while a diagnosis is under way: `save_diagnosis` deletes it.

    Args:
        run: the run folder, which holds the fit.
        result: that fit.
    """

    remark = ""  # that rounds which were there could not be taken up, and where they lie now

    def __init__(self, run: Path, result: FitResult) -> None:
        self._path = run / DIAGNOSIS_ROUNDS
        self._fit = digest(run / FIT_STATE)
        self._known = {FIT_STATE: result}
        self._last: Progress | None = None

    def read(self) -> Progress | None:
        """The rounds that were made of this fit with the settings of today; None where there are none."""
        if not self._path.exists():
            return None
        try:
            kept, why = codec.load(self._path, self._known), "are of another fit or other settings"
        except codec.Unreadable as error:
            kept, why = None, f"cannot be read ({error})"
        if isinstance(kept, _Kept) and kept.fit == self._fit and kept.settings == DEFAULT:
            self._last = kept.progress
        else:
            self.remark = f"The rounds in {self._path} {why}: moved to {put_aside(self._path)}, and begun again."
        return self._last

    def keep(self, progress: Progress) -> None:
        """Write them, whole or not at all."""
        codec.save(self._path, _Kept(self._fit, progress.model.settings, progress), self._known)
        self._last = progress

    def when_interrupted(self) -> str:
        """What was found so far, and how to go on."""
        again = command("diagnose", self._path.parent)
        if self._last is None or not self._last.rounds:
            return f"interrupted before the first round. `{again}` begins again."
        found = listed([each.effect.name for each in self._last.found]) if self._last.found else "nothing"
        return (
            f"interrupted after round {len(self._last.rounds)}. Found so far, not yet compared with rivals: {found}. "
            f"{self._path} keeps it: `{again}` goes on from there."
        )
