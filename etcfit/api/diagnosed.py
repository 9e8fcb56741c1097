"""A diagnosis as a notebook holds it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from ..diagnosis.findings import Diagnosis
from ..problem.prediction_error import pooled
from ..reporting.numbers import short
from . import words
from .fit import Fit
from .frames import candidate_frame, ledger_frame

if TYPE_CHECKING:
    from .plots import DiagnosisPlots

_SHOWN = 30  # rows of the ledger in a notebook


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosed:
    """What a model lacked: `etcfit.diagnose(fit)`.

    Args:
        diagnosis: in full.
    """

    diagnosis: Diagnosis

    @cached_property
    def before(self) -> Fit:
        """The fit that was diagnosed."""
        return Fit(self.diagnosis.before)

    @cached_property
    def final(self) -> Fit:
        """The fit of the model with what was found."""
        return Fit(self.diagnosis.after)

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that were found, in that order."""
        return self.diagnosis.added

    @property
    def verdict(self) -> str:
        """The whole in a few sentences."""
        return " ".join(self.diagnosis.verdict)

    @property
    def ties(self) -> tuple[tuple[str, ...], ...]:
        """Effects that these data cannot tell apart."""
        return tuple(tie.effects for tie in self.diagnosis.ties)

    @property
    def unexplained(self) -> str | None:
        """What no effect explains, in a sentence."""
        return None if self.diagnosis.unexplained is None else self.diagnosis.unexplained.sentence

    @property
    def ledger(self) -> pd.DataFrame:
        """Free-running error before and after, one row a file and channel, fitted and held out."""
        return ledger_frame(self.diagnosis)

    @property
    def candidates(self) -> pd.DataFrame:
        """Every effect that was tried, one row a round and effect."""
        return candidate_frame(self.diagnosis)

    @property
    def plot(self) -> DiagnosisPlots:
        """Pictures: `plot.ledger()`, `plot.missing_torque()`, `plot.trace(file)`, ..."""
        from .plots import DiagnosisPlots

        return DiagnosisPlots(self.diagnosis)

    def summary(self, width: int = 140) -> str:
        """What `etcfit diagnose` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.diagnosis.table import diagnosis_table

        return render(diagnosis_table(self.diagnosis), width)

    def save(self, run: str | Path) -> Path:
        """Write the diagnosis, and the fit that it began from, to a run folder, whole.

        Args:
            run: made if absent.
        """
        from ..run_folder import RunFolder
        from .saving import keep_diagnosis, keep_fit

        folder = RunFolder(run)
        keep_fit(folder, self.diagnosis.before)
        keep_diagnosis(folder, self.diagnosis)
        return Path(run)

    @property
    def _errors(self) -> list[str]:
        """How far both models are off on average, fitted and held out."""
        was, now = self.diagnosis.before, self.diagnosis.after
        pairs = {"fitted": (was.score_fit, now.score_fit), "held out": (was.score_holdout, now.score_holdout)}
        return [f"{name}: rms error {short(pooled(a))} -> {short(pooled(b))} sigma"
                for name, (a, b) in pairs.items() if a and b]  # fmt: skip

    @property
    def _alarm(self) -> str:
        return "" if self.final.converged else f"THE FINAL FIT DID NOT CONVERGE, NOT CONVERGED: {self.final.reason}"

    def __repr__(self) -> str:
        return words.block(
            f"Diagnosis of {words.name_of(self.diagnosis.after.rig.config)}: "
            f"{len(self.diagnosis.rounds)} rounds, found {', '.join(self.added) or 'nothing'}",
            self._alarm,
            *self._errors,
            self.verdict,
        )

    def _repr_html_(self) -> str:
        rows = [(r["file"], r["channel"], "held out" if r["held_out"] else "fitted",
                 short(r["before"]), short(r["after"]), r["unit"],
                 short(r["before_in_sigma"]), short(r["after_in_sigma"]))
                for r in self.ledger.reset_index().to_dict("records")]  # fmt: skip
        rows.sort(key=lambda row: row[2] != "held out")
        head = ("file", "channel", "", "before", "after", "unit", "before/sigma", "after/sigma")
        more = f"... and {len(rows) - _SHOWN} more, see .ledger" if len(rows) > _SHOWN else ""
        return words.card(
            self.diagnosis.after.rig.config,
            f"Eqs. 1-2 lack {', '.join(self.added)}" if self.added else "no effect added",
            words.paragraph(self.verdict),
            words.table(head, rows[:_SHOWN]),
            words.paragraph(more),
            words.folded("Warnings", self.final.warnings),
            alarm=self._alarm,
        )
