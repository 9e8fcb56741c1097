"""The last word of a diagnosis: whether its final model is kept, and the whole in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence

from ..estimation.result import FitResult
from ..problem.prediction_error import pooled
from .exchange import Found
from .findings import RigMistake, RoundReport, Statement, Tie, Unexplained
from .score import clearly_worse
from .settings import DiagnosisSettings

_NOTHING = "The residual is noise: the model lacks nothing that these data show."


def runs_free_worse(after: FitResult, before: FitResult, settings: DiagnosisSettings) -> bool:
    """Whether the final model, run free, predicts held-out traces clearly worse than the first fit does.

    The RMS of the fitted traces is compared where none are held out. Far from the data effects are judged in a guided
    residual, which a wrong one may lower too.
    """
    end, beginning = (pooled(result.score_holdout or result.score_fit) for result in (after, before))
    return clearly_worse(end, beginning, settings.refit_rise)


def tie(found: Found) -> Tie:
    """An effect found and those that these data cannot tell from it."""
    group = (found.effect, *found.ties)
    told_by = "; ".join(f"{e.name}: {e.told_by}" for e in group)
    return Tie(tuple(e.name for e in group), tuple(each.residual for each in found.ties.values()), told_by)


def verdict(
    stated: Sequence[Statement],
    ties: Sequence[Tie],
    left: Unexplained | None,
    rounds: Sequence[RoundReport],
    rig: Sequence[RigMistake] = (),
) -> tuple[str, ...]:
    """The whole in a few sentences: what was found and how sure, what cannot be told apart, what is left.

    Args:
        stated: on each effect found.
        ties: of those.
        left: the curve without a name, if there is one.
        rounds: all of them, the last of which adds nothing unless they ran out.
        rig: what of those found is wrong with the rig.
    """
    of_the_rig = {mistake.effect for mistake in rig}
    words = [each.sentence for each in sorted(stated, key=lambda each: each.effect not in of_the_rig)]
    if not words:
        white = rounds[0].evidence.white
        words.append(_NOTHING if white else "No effect of the catalogue is proven by these data.")
    words += [
        f"{' and '.join(tie.effects)} cannot be told apart by these data: their fits differ by at most "
        f"{max(tie.apart):.2g} times the noise."
        for tie in ties
    ]
    if left is not None:
        words.append(left.sentence)
    elif not rounds[-1].candidates:
        words.append(rounds[-1].why)
    elif not rounds[-1].evidence.white:
        words.append("The residual is not all noise, but nothing that was tried explains what is left.")
    return tuple(words)
