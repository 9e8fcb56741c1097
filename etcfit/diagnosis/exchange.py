"""Looking back: an effect is exchanged for a rival, or taken away."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..estimation.joint_fit import Report
from ..problem.cores import concurrently
from .candidate_model import CandidateModel
from .choice import TIED_LIKELIHOOD, Choice, Outcome, alike, is_accepted
from .composition import Effect, resting
from .formula_errors import FormulaErrors
from .loop import Round
from .refit import is_no_worse, refit_fully, refit_worsened
from .score import Apart, Score, baseline, distance_to, folds, left_out, score
from .trial import Cost, Trial, TrialVerdict, bic_change, judge_trial, run_trial

# ---- Looking back: each effect found is compared again with its rivals, now that all later effects are in the model
#
# While several effects were missing, an effect may have been mistaken for a similar one. So each effect is compared
# again with the rivals of its round, in its place in the final model; and the model is tried without each of them.
#
# Source: stepwise selection with exchange (Miller 2002, Subset Selection in Regression, ch. 3). Differs from source:
# the rivals of an effect are those that explained at least half as much in its round, not all candidates.


# share of the fall of chi2 of the effect added that another must exceed to be compared in the final model
EXCHANGE_RIVAL = 0.5


@dataclass(frozen=True)
class Found:
    """An effect that was added, and the other effects of its round that explained much of the same."""

    effect: Effect  # the effect added
    # others that explain these data equally well, and how far their fits are from this one's
    ties: Mapping[Effect, Apart]
    # others that explained at least half as much, with the values at which their refits ended, SI by symbol: at least
    # those of their own parameters
    rivals: Mapping[Effect, Mapping[str, float]]

    @classmethod
    def of_round(cls, turned: Round) -> Found:
        """The effect that a round added."""
        best = turned.best
        rivals = {t.verdict.effect: t.model.values for t in turned.trials if is_rival(t.verdict, best.verdict)}
        ties = _apart(best, (t for t in turned.trials if t.verdict.effect in turned.choice.ties))
        return cls(best.verdict.effect, ties, rivals)

    def without_ties_to(self, at_work: Iterable[Effect]) -> Found:
        """The same without ties to effects at work: the data distinguish two effects that are both in the model."""
        at_work = set(at_work)
        return replace(self, ties={effect: far for effect, far in self.ties.items() if effect not in at_work})


def is_rival(v: TrialVerdict, best: TrialVerdict) -> bool:
    """Whether another effect explained more than the share `EXCHANGE_RIVAL` of what the added one explained."""
    return v.effect is not best.effect and v.gain > EXCHANGE_RIVAL * best.gain


def _apart(best: Trial, ties: Iterable[Trial]) -> dict[Effect, Apart]:
    return {t.verdict.effect: distance_to(t.model, best.model) for t in ties}


# ---- one effect given up for another


def preference(here: TrialVerdict, others: Sequence[TrialVerdict]) -> tuple[int, tuple[int, ...]]:
    """Which of an effect (0) and its rivals (1, 2, ...) explains most for its parameters, and which fit equally well.

    The effect itself stays where the best one ties with it and BIC does not choose between the two: a formula with more
    parameters may fit as well as the right one.
    """
    every = (here, *others)
    best = min(every, key=lambda v: v.bic_change)
    even = here.bic_change - best.bic_change < TIED_LIKELIHOOD
    best = here if even and alike(here, best) else best
    ties = (k for k, v in enumerate(every) if v is not best and alike(v, best))
    return next(k for k, v in enumerate(every) if v is best), tuple(ties)


def replaced_in_order(added: Sequence[Effect], old: Effect, new: Effect) -> tuple[Effect, ...]:
    """The effects added, one of them exchanged for another, in the order in which they were found."""
    return tuple(new if e is old else e for e in added)


def gave_way(old: TrialVerdict, new: TrialVerdict) -> str:
    """One sentence for an exchange."""
    more = new.bic_change - old.bic_change
    return f"{old.effect.name} gave way to {new.effect.name}, which explains more (BIC {more:+.1f})."


class LookBack(NamedTuple):
    """The result of a comparison of effects with their rivals."""

    model: CandidateModel  # the model after it
    found: tuple[Found, ...]  # the effects in the model, and those taken away
    changed: tuple[str, ...] = ()  # a sentence for each exchange
    rounds: tuple[Round, ...] = ()  # one for each effect that a rival replaced, with the trials of both


def exchanged(s: CandidateModel, found: Sequence[Found], report: Report) -> LookBack:
    """Compare each effect with its rivals, all other effects at work, and exchange it for one that explains more."""
    now, words, rounds = list(found), [], []
    for k, each in enumerate(found):
        rivals = {e: v for e, v in each.rivals.items() if not s.at_work(e)}
        if not rivals:
            continue
        report(f"comparing {each.effect.name} again with its rivals", 0.88)
        base = s.without(each.effect).optimised()
        before = baseline(base)
        every = compared_in_place(s, each.effect, rivals, base, before)
        chosen, tied = preference(every[0].verdict, [t.verdict for t in every[1:]])
        best = every[chosen]
        ties = _apart(best, (every[tie] for tie in tied))
        if chosen:
            new = refit_fully(best.model, report)
            if not is_no_worse(new, s, score(s)) or contradicted(best.model, s):
                continue
            words.append(gave_way(every[0].verdict, best.verdict))
            choice = Choice(Outcome.ADDED, best.verdict.effect, tuple(ties), words[-1])
            rounds.append(Round(base, before, (), tuple(sorted(every, key=lambda t: t.verdict.bic_change)), choice))
            s = replace(new, added=replaced_in_order(s.added, each.effect, best.verdict.effect))
        now[k] = replace(each, effect=best.verdict.effect, ties=ties)
    return LookBack(s, tuple(each.without_ties_to(s.added) for each in now), tuple(words), tuple(rounds))


def compared_in_place(
    s: CandidateModel,
    effect: Effect,
    rivals: Mapping[Effect, Mapping[str, float]],
    base: CandidateModel,
    before: Score,
) -> tuple[Trial, ...]:
    """Trials of the effect and of the accepted rivals, in this order, each over the base: the model with none of them.

    A rival starts from the optimum of the base and from the end of its own refit, and the deeper end counts: the base
    alone may lie in another valley.
    """

    def deepest(rival: Effect) -> Trial:
        values, own = rivals[rival], resting(rival)
        there = s.at_end_of(replaced_in_order(s.added, effect, rival), values)
        ends = (
            run_trial(base, rival, {k: values[k] for k in own}, before),
            judge_trial(rival, before, there.optimised()),
        )
        return min(ends, key=lambda t: t.verdict.score.chi2)

    others = concurrently(deepest, list(rivals))
    return judge_trial(effect, before, s), *(t for t in others if is_accepted(t.verdict, s.settings))


def contradicted(new: CandidateModel, old: CandidateModel) -> bool:
    """Whether the new model predicts traces left out in turn worse, where no traces are declared as held out."""
    return new.holdout is None and bool(folds(new)) and left_out(new) > left_out(old)


# ---- one effect taken away


def pruned(s: CandidateModel, report: Report) -> tuple[CandidateModel, tuple[str, ...]]:
    """Take away each added effect that is no longer worth its parameters while the others, whose formulas are inexact,
    are at work; a sentence for each. An effect that was found alone stays.
    """
    words = []
    for effect in s.added if len(s.added) > 1 else ():
        report(f"trying without {effect.name}", 0.9)
        less = s.without(effect).optimised()
        errors = FormulaErrors.of_model(less)
        change = -bic_change(score(less, errors), score(s, errors), Cost(len(resting(effect)), 1))
        if change < 0.0 and not refit_worsened(new := refit_fully(less, report), s):
            words.append(f"{effect.name} was taken away again: later effects explain the same (BIC {change:+.1f}).")
            s = new
    return s, tuple(words)
