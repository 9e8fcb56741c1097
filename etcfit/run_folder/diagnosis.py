"""diagnosis.json, and the rounds of a diagnosis under way: one that was interrupted goes on from there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..diagnosis.findings import Diagnosis, RoundReport, Unexplained
from ..diagnosis.rounds import Progress
from ..diagnosis.settings import DEFAULT, DiagnosisSettings
from ..errors import command
from ..estimation.identifiability import listed
from ..estimation.result import FitResult
from ..files import plain, put_aside
from ..rig.base import Finding
from . import codec
from .fit import AGREEMENT, FIT, ROW, SCORE, effects_of, rows_of, score_of, versions
from .manifest import DIAGNOSIS_ROUNDS, FIT_STATE, digest


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The object of diagnosis.json (docs/formats.md), and what else a reader may want to know.

    Effects are those of the whole model, Eqs. 1-2 among them, as in fit.json; numbers are in the unit that stands
    beside them.
    """
    before, after, unknown = diagnosis.before, diagnosis.after, diagnosis.unexplained
    return {
        "schema": "etcfit.diagnosis/1",
        "name": after.rig.config.name,
        "synthetic": after.rig.config.synthetic,
        "converged": after.converged,
        "reason": after.reason,
        "verdict": list(diagnosis.verdict),
        "start": {"effects": list(effects_of(before))},
        "final": {"effects": list(effects_of(after))},
        "rounds": [_round(each, tuple(effects_of(before))) for each in diagnosis.rounds],
        "added": list(diagnosis.added),
        "removed": list(diagnosis.removed),
        "sets": [plain(each) for each in diagnosis.sets],
        "ties": [list(tie.effects) for tie in diagnosis.ties],
        "ties_apart": [list(tie.apart) for tie in diagnosis.ties],
        "ties_told_by": [tie.told_by for tie in diagnosis.ties],
        "rig": [
            *({**plain(each), "probability": plain(diagnosis.probabilities.get(each.effect)), "chance": None}
              for each in diagnosis.rig),
            *map(_found_before, after.rig.findings),
        ],
        "statements": [plain(each) for each in diagnosis.statements],
        "questions": [plain(each) for each in diagnosis.questions],
        "probabilities": plain(dict(diagnosis.probabilities)),
        "unexplained": _unexplained(unknown) if unknown is not None else None,
        "discrepancy": [plain(each) for each in diagnosis.discrepancy],
        "before": plain(SCORE.written(score_of(before))),
        "after": plain(SCORE.written(score_of(after))),
        "after_with_unknown": None if unknown is None else {
            "fit": [plain(ROW.written(row)) for row in rows_of(unknown.fit)],
            "holdout": [plain(ROW.written(row)) for row in rows_of(unknown.holdout)],
        },
        "parameters": plain(FIT.keys["parameters"].value(after)),
        **plain(AGREEMENT.written(after)),
        "settings": plain(diagnosis.settings),
        "warnings": list(after.warnings),
        "folder": after.rig.folder,
        "files": dict(after.rig.digests),
        "versions": versions(),
    }  # fmt: skip


def _found_before(finding: Finding) -> dict[str, Any]:
    """What the records show before any fit; `chance` is that of a rig without it, no probability of the mistake."""
    return plain({
        "effect": None,
        "kind": finding.kind,
        "test": finding.test,
        "channel": finding.channel,
        "size": finding.size,
        "unit": finding.unit,
        "mend": finding.mend,
        "sentence": finding.found,
        "file": finding.file,
        "probability": None,
        "chance": finding.chance,
        "suspected": False,
    })  # fmt: skip


def _round(each: RoundReport, known: tuple[str, ...]) -> dict[str, Any]:
    return {
        "effects": list(dict.fromkeys((*known, *each.effects))),
        "white": each.evidence.white,
        "evidence": plain(each.evidence.rows),
        "evidence_says": list(each.evidence.sentences),
        "shares": plain(each.evidence.shares),
        "fit_rms": plain(each.fit_rms),
        "holdout_rms": plain(each.holdout_rms),
        "candidates": plain(each.candidates),
        "added": each.added,
        "ties": list(each.ties),
        "why": each.why,
    }


def _unexplained(unknown: Unexplained) -> dict[str, Any]:
    return plain({
        "enters": unknown.enters,
        "depends_on": unknown.depends_on,
        "shape": {"axis": unknown.axis, "axis_unit": unknown.axis_unit, "curve": unknown.curve, "unit": unknown.unit,
                  "sd": unknown.sd},
        "size": unknown.size,
        "sentence": unknown.sentence,
        "fit_rms_ratio": unknown.fit_rms_ratio,
        "holdout_rms_ratio": unknown.holdout_rms_ratio,
        "bic_change": unknown.bic_change,
        "doubts": list(unknown.doubts),
    })  # fmt: skip


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
