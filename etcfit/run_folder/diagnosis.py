"""diagnosis.json, declared: every key and what of a diagnosis it is; and the rounds of a diagnosis under way: one that
was interrupted goes on from there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..diagnosis.findings import (
    Candidate,
    Diagnosis,
    Discrepancy,
    Question,
    RigMistake,
    SetTried,
    Share,
    Statement,
    Unexplained,
    Whiteness,
)
from ..diagnosis.rounds import Progress
from ..diagnosis.settings import DEFAULT, DiagnosisSettings
from ..errors import command
from ..estimation.identifiability import listed
from ..estimation.intervals import intervals
from ..estimation.result import FitResult
from ..files import put_aside
from . import codec
from .declared import CONVERGED, REASON, SYMBOL, WARNINGS, Record, by_name, effects_of, file_of, key, list_of, record_of
from .fit import AGREEMENT, PARAMETER, ROW, SCORE, described, rows_of, score_of
from .manifest import DIAGNOSIS_ROUNDS, FIT_STATE, digest


def _mistakes(found: Diagnosis) -> list[dict[str, Any]]:
    """Those of the diagnosis, and what the records show before any fit: its `chance` is that of a rig without it, no
    probability of the mistake."""
    seen = {"effect": None, "probability": None, "suspected": False}
    return [
        *(vars(each) | {"probability": found.probabilities.get(each.effect), "chance": None} for each in found.rig),
        *(vars(each) | {"sentence": each.found} | seen for each in found.after.rig.findings),
    ]


EFFECTS = Record(
    effects=key("[text]", "Names, those of Eqs. 1-2 among them.", effects_of),
)  # fmt: skip
EVIDENCE = record_of(Whiteness, null=("rms", "ljung_box", "correlation", "p"), ref="evidence")
SHARE = record_of(Share, null=("share",))
CANDIDATE = record_of(
    Candidate,
    null=("screened", "own"),
    optional=("screened", "own", "refitted", "holdout_chi2_change", "prior"),
    ref="candidate",
)
ROUND = Record(
    "One turn.",
    effects=key("[text]", "The model it began with."),
    white=key("flag", "Its residual is noise already.", "evidence.white"),
    evidence=key(list_of(EVIDENCE), "Its residual, channel by channel.", "evidence.rows"),
    evidence_says=key("[text]", "The same in words.", "evidence.sentences", optional=True),
    shares=key(list_of(SHARE), "What the missing torque and voltage depend on, largest first.", "evidence.shares",
        optional=True),
    fit_rms=key("number?", "Free-running error of the fitted traces, in units of their noise.", optional=True),
    holdout_rms=key("number?", "The same of the held-out ones; null without any.", optional=True),
    candidates=key(list_of(CANDIDATE), "The effects tried, most promising first."),
    added=key("text?", "The effect found, or null."),
    ties=key("[text]", "Effects that would have done as well.", optional=True),
    why=key("text", "One sentence."),
)  # fmt: skip
SET = record_of(SetTried)
SHAPE = Record(
    axis=key("[number]", "Where."),
    axis_unit=key("text", "Of it."),
    curve=key("[number?]", "Value."),
    unit=key("text", "Of it."),
    sd=key("[number?]", "Its standard deviation."),
)  # fmt: skip
UNEXPLAINED = record_of(
    Unexplained,
    null=("size", "fit_rms_ratio", "holdout_rms_ratio", "bic_change"),
    optional=("sentence", "fit_rms_ratio", "holdout_rms_ratio", "bic_change", "corrects"),
    without=("unit", "axis_unit", "axis", "curve", "sd", "fit", "holdout"),
    shape=key(SHAPE, "The curve.", ""),
)
STATEMENT = record_of(
    Statement,
    shares=("probability",),
    certainty=key("text", "found from 0.90, probably from 0.70, may be below.", enum=["found", "probably", "may be"]),
)
QUESTION = record_of(Question, shares=("answers",))
DISCREPANCY = record_of(Discrepancy)
WITH_UNKNOWN = Record(
    fit=key(list_of(ROW), "Fitted traces.", lambda unknown: rows_of(unknown.fit)),
    holdout=key(list_of(ROW), "Held-out traces.", lambda unknown: rows_of(unknown.holdout)),
)  # fmt: skip
MISTAKE = record_of(
    RigMistake,
    optional=("suspected",),
    meaning="",
    effect=key("text?", "Name of the effect that takes it into account, as in `added`; null: found before any fit, "
        "and not fitted.", "effect"),
    probability=key("number?", "Null: not calibrated."),
    chance=key("number?", "Probability that a rig without the mistake would look so; null: found by the diagnosis."),
).closed()  # fmt: skip
ERRORS = Record(
    "Errors.", "score",
    **SCORE.keys | {name: SCORE.keys[name]._replace(optional=True) for name in ("explained", "explained_holdout")},
)  # fmt: skip
DIAGNOSIS = file_of(
    "What the fitted model lacks, and the final model: written by `etcfit diagnose`.",
    "after.rig.config", "", "after.rig", "name",
    converged=CONVERGED.taken_from("after.converged"),
    reason=REASON.taken_from("after.reason"),
    verdict=key("[text]", "The whole in a few sentences."),
    start=key(EFFECTS, "The model of the fit that was taken up.", "before"),
    final=key(EFFECTS, "The final model.", "after"),
    rounds=key(list_of(ROUND), "Each turn of the loop; the last one adds nothing.", lambda found: [
        vars(each) | {"effects": [*dict.fromkeys((*effects_of(found.before), *each.effects))]}
        for each in found.rounds]),
    added=key("[text]", "Effects found, in the order found; empty where the first model already explains the data."),
    removed=key("[text]", "A sentence for each effect that gave way to another, or was taken away again."),
    sets=key(list_of(SET), "Far from the data: the set of effects that was grown in the free run.", optional=True),
    ties=key("[[text]]", "Groups of effects that these data cannot tell apart; the first of each is in the model.",
        lambda found: [tie.effects for tie in found.ties], each={"description": "Names."}),
    ties_apart=key("[[number?]]", "For each tie, how far the fits with the others are from that with the first: rms "
        "over samples, in units of the noise.", lambda found: [tie.apart for tie in found.ties],
        each={"description": "One number for each of the others."}),
    ties_told_by=key("[text]", "For each tie, the measurement that would separate them.",
        lambda found: [tie.told_by for tie in found.ties]),
    rig=key(list_of(MISTAKE), "Mistakes and habits of the rig itself: those that the diagnosis found (each is one of "
        "`added` too), then those that the records show before any fit.", _mistakes),
    statements=key(list_of(STATEMENT), "What is stated of each effect added, in the order found. Not written by every "
        "version.", optional=True),
    questions=key(list_of(QUESTION), "One question a round with its answers, and at last one on what is left. Not "
        "written by every version.", optional=True),
    probabilities=key("{number}", "Probability of each effect or rig mistake, of nothing, and of unexplained. Not "
        "written by every version.", optional=True, each={"description": "Probability.", "minimum": 0, "maximum": 1}),
    unexplained=key(UNEXPLAINED, "Structure that no named effect explains, as a smooth curve; null where there is "
        "none.", null=True),
    discrepancy=key(list_of(DISCREPANCY), "Random curves that what is left in the residual of the final model shows, "
        "and that intervals allow for; empty where nothing is left, or the model is far from its data.",
        optional=True),
    before=key(ERRORS, "Free-running errors of the first model.", lambda found: score_of(found.before)),
    after=key(ERRORS, "Free-running errors of the final model.", lambda found: score_of(found.after)),
    after_with_unknown=key(WITH_UNKNOWN, "Free-running errors with the curve of `unexplained` in the model; null "
        "without one.", "unexplained", null=True),
    parameters=key(by_name(PARAMETER), "As in fit.json, of the final model.",
        lambda found: described(found.after, intervals(found.after)), propertyNames=SYMBOL),
    **AGREEMENT.within("after"),
    settings=key("object", "What the diagnosis decided by: every field of `etcfit.DiagnosisSettings`."),
    warnings=WARNINGS.taken_from("after.warnings"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Kept:
    """What the file holds."""

    fit: str | None  # SHA-256 of the file of the fit that is diagnosed
    settings: DiagnosisSettings  # of the diagnosis
    progress: Progress  # the rounds, and the model after them


class KeptRounds:
    """RUN/diagnosis_rounds.npz, there while a diagnosis is under way: `save_diagnosis` deletes it."""

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
