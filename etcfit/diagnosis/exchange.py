"""The look back: effects found one after the other, each asked again beside all that came after it.

What was missing together with others may have been taken for something like it. So each effect is compared once more
with the rivals of its round, in its place in the final model; and each but the last is tried to be taken away.

Source: stepwise selection with exchange (Miller 2002, Subset Selection in Regression, ch. 3). Differs from source: the
rivals of an effect are those that explained at least half as much in its round, not all candidates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ..estimation.joint_fit import Report
from .ambiguity import Apart, apart
from .composition import Effect, resting
from .cross_validation import folds, left_out
from .loop import STRONG, Round, alike, judged, refit_fully, tried
from .trial import CandidateModel, TrialVerdict, bic_change, score

_RIVAL = 0.5  # share of what the effect explained in its round that another must have explained to be asked again


@dataclass(frozen=True)
class Found:
    """An effect at work, and what stood against it.

    Args:
        effect: which.
        ties: others that explain these data as well, and how far their fits are from this one's.
        worth: by how much it lowered BIC.
        rivals: others that explained a good part of it, and the values (SI) at which they did.
    """

    effect: Effect
    ties: Mapping[Effect, Apart]
    worth: float
    rivals: Mapping[Effect, Mapping[str, float]]

    @classmethod
    def of(cls, turned: Round) -> Found:
        """What a round found."""
        best = turned.best
        rivals = {v.effect: _values(v) for v in turned.verdicts if v is not best and v.gain > _RIVAL * best.gain}
        ties = [v for v in turned.verdicts if v.effect in turned.ties]
        return cls(best.effect, _apart(best, ties), -best.bic_change, rivals)


def _apart(best: TrialVerdict, ties: Iterable[TrialVerdict]) -> Mapping[Effect, Apart]:
    return {v.effect: apart(v.standing, best.standing) for v in ties}


def _values(v: TrialVerdict) -> Mapping[str, float]:
    """Values of its own parameters at its optimum, SI by symbol."""
    values = v.standing.problem.layout.values(v.standing.x, v.standing.problem.free_parameters.held)
    return {symbol: float(values[symbol]) for symbol in resting(v.effect)}


def exchanged(
    s: CandidateModel, found: Sequence[Found], report: Report
) -> tuple[CandidateModel, tuple[Found, ...], tuple[str, ...]]:
    """Each effect beside its rivals, all others at work; the model, what was found, a sentence for each exchange."""
    now, words = list(found), []
    for k, each in enumerate(found):
        rivals = {e: v for e, v in each.rivals.items() if not s.at_work(e)}
        if not rivals:
            continue
        report(f"asking again whether it is {each.effect.name}", 0.88)
        here, others = _beside(s, each.effect, rivals)
        best = min((here, *others), key=lambda v: v.bic_change)
        best = here if alike(here, best) else best
        if best is not here:
            new = refit_fully(best.standing, report)
            if not new.holds(s, score(s)) or _contradicted(best.standing, s):
                continue
            more = best.bic_change - here.bic_change
            words.append(f"{each.effect.name} gave way to {best.effect.name}, which explains more (BIC {more:+.1f}).")
            s = replace(new, added=tuple(best.effect if e is each.effect else e for e in s.added))  # its place stays
        ties = _apart(best, (v for v in (here, *others) if v is not best and alike(v, best)))
        now[k] = replace(each, effect=best.effect, ties=ties, worth=-best.bic_change)
    return s, tuple(_apart_from(s, each) for each in now), tuple(words)


def _apart_from(s: CandidateModel, each: Found) -> Found:
    """Two effects that are both at work were told apart."""
    return replace(each, ties={effect: far for effect, far in each.ties.items() if not s.at_work(effect)})


def _beside(
    s: CandidateModel, effect: Effect, rivals: Mapping[Effect, Mapping[str, float]]
) -> tuple[TrialVerdict, tuple[TrialVerdict, ...]]:
    """The effect, and those rivals that are worth their parameters and not contradicted, each over neither."""
    base = s.without(effect).optimised()
    before = score(base)
    others = [tried(base, rival, values, before) for rival, values in rivals.items()]
    good = tuple(v for v in others if v.bic_change < STRONG and v.helps_elsewhere())
    return judged(effect, before, s), good


def _contradicted(new: CandidateModel, old: CandidateModel) -> bool:
    """Where no traces are declared as held out, those left out in turn are worse off with the new model."""
    return new.holdout is None and bool(folds(new)) and left_out(new) > left_out(old)


def pruned(s: CandidateModel, report: Report) -> tuple[CandidateModel, tuple[str, ...]]:
    """Try to take each added effect away again; what is taken, and a sentence for each."""
    words = []
    for effect in s.added[:-1]:
        report(f"trying without {effect.name}", 0.9)
        less, here = s.without(effect).optimised(), score(s)
        change = -bic_change(score(less), here, len(resting(effect)), 1)
        if change < 0.0 and not (new := refit_fully(less, report)).spoilt(s):
            words.append(f"{effect.name} was taken away again: what came after explains it (BIC {change:+.1f}).")
            s = new
    return s, tuple(words)
