"""Round after round until one adds nothing, and each of them as data for the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from ..estimation.joint_fit import Report
from ..estimation.remedies import listed
from ..estimation.result import FitResult
from .ambiguity import Apart
from .candidate_model import CandidateModel
from .composition import Effect
from .evidence import evidence
from .exchange import Found
from .findings import Candidate, RoundReport
from .loop import Round, settled, turn
from .masked_by_guide import hidden
from .model_discrepancy import blur


@dataclass(frozen=True, eq=False)
class Progress:
    """How far the diagnosis has come.

    Args:
        model: the model with all that was added.
        found: the effects added, in the order found.
        rounds: those made.
        changed: a sentence for each effect that gave way to another or was taken away again.
        even: other sets of effects that these data do not choose against, and how far their fits are.
        free: values of the best free run of this model that is known, SI by symbol; empty where none is.
    """

    model: CandidateModel
    found: tuple[Found, ...] = ()
    rounds: tuple[RoundReport, ...] = ()
    changed: tuple[str, ...] = ()
    even: Mapping[frozenset[Effect], Apart] = field(default_factory=dict)
    free: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_at_an_end(self) -> bool:
        """Whether the last round added nothing."""
        return bool(self.rounds) and self.rounds[-1].added is None

    @property
    def beside_ties(self) -> dict[frozenset[Effect], Apart]:
        """Of the even sets those that differ from the model's own by more than what is said to be a tie."""
        here = frozenset(self.model.added)
        tied = [frozenset((each.effect, *each.ties)) for each in self.found]
        return {s: apart for s, apart in self.even.items() if not any(s ^ here <= group for group in tied)}

    def back_to(self, first: CandidateModel, *words: str) -> Progress:
        """With the first model in place of the one reached."""
        return replace(self, model=first, changed=(*self.changed, *words), even={}, free={})


Keep = Callable[[Progress], None]  # is given the progress after every round


def forget(progress: Progress) -> None:
    """Keeps nothing."""


def forward(
    result: FitResult, progress: Progress, report: Report, most: int | None = None, keep: Keep = forget
) -> Progress:
    """Rounds from here until one adds nothing or `most` are made in all.

    Args:
        result: the first fit.
        progress: where to go on from.
        report: progress in words.
        most: rounds in all; `rounds` of the settings where None.
        keep: is given the progress after every round that added something.
    """
    limit = progress.model.settings.rounds
    most = limit if most is None else min(most, limit)
    while (made := len(progress.rounds)) < most:
        turned, s = _round(result, progress.model, _in_stage(report, made, limit), first=not made)
        progress = replace(progress, model=s, rounds=(*progress.rounds, reported(turned)))
        report(f"round {made + 1}: {turned.choice.why}", (made + 0.5) / limit)
        if turned.added is None:
            break
        progress = replace(progress, found=(*progress.found, Found.of(turned)))
        keep(progress)
    return progress


def _round(result: FitResult, s: CandidateModel, report: Report, first: bool) -> tuple[Round, CandidateModel]:
    """One round and the model after it; a first one that stays far from the data is asked what the guide hides."""
    turned, new = settled(turn(s, report, blur(result.chi2_per_dof, s)), report)
    if first and new.far:
        return hidden(result, turned, report) or (turned, new)
    return turned, new


def _in_stage(report: Report, made: int, most: int) -> Report:
    return lambda text, share: report(f"round {made + 1}: {text}", (made + share) / most)


def reported(turned: Round) -> RoundReport:
    """A round as plain data: candidates that were tried first, the lowest BIC first of them."""
    tried = {t.verdict.effect: t.verdict for t in turned.trials}
    screened = {g.variant.effect: (g.gain, g.own) for g in turned.screened}
    # one that was refitted without a screening, for a check found it: what the refit gained stands for its promise
    screened |= {effect: (v.gain, 0.0) for effect, v in tried.items() if effect not in screened}
    candidates = []
    for effect, (gain, own) in screened.items():
        v = tried.get(effect)
        bare = Candidate(effect.name, gain, own, v is not None)
        candidates.append(bare if v is None else replace(
            bare, fit_rms_ratio=v.fit_rms_ratio, holdout_rms_ratio=v.holdout_rms_ratio,
            holdout_chi2_change=v.holdout_chi2_change, bic_change=v.bic_change, prior=v.prior))  # fmt: skip
    candidates.sort(key=lambda c: (c.bic_change is None, c.bic_change or -c.screened))
    return RoundReport(
        effects=tuple(e.name for e in turned.before.added),
        evidence=evidence(turned.before),
        fit_rms=turned.score.fit_rms,
        holdout_rms=turned.score.holdout_rms,
        candidates=tuple(candidates),
        added=turned.added.name if turned.added else None,
        ties=tuple(e.name for e in turned.choice.ties),
        why=turned.choice.why,
    )


def names(s: CandidateModel) -> str:
    """The effects added, in words."""
    return listed(e.name for e in s.added)
