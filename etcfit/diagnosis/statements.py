"""Writes the sentences of a diagnosis: how sure each named effect is, mistakes of the rig with their cure, the verdict.

`course` calls it at the end, with the probabilities of `probabilities`; terminal, pages and closing lines print its
sentences.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from ..estimation.result import FitResult
from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from ..problem.prediction_error import pooled
from .composition import Effect
from .exchange import Found
from .findings import Question, RigMistake, RoundReport, Statement, Tie, Unexplained
from .probabilities import SOMETHING_ELSE, likely_hypotheses, likely_in_one_line
from .score import clearly_worse
from .settings import DiagnosisSettings

# ---- The statement on each named effect: how sure it is, other explanations, and the measurement that would decide


FOUND, PROBABLY = 0.9, 0.7
_LACKED = {"found": "Found: the model lacked", "probably": "Probably the model lacked", "may be": "The model may lack"}
_MISTAKE = {"found": "Found: a mistake of the rig", "probably": "Probably a mistake of the rig",
            "may be": "There may be a mistake of the rig"}  # fmt: skip


def certainty(probability: float) -> str:
    """The word for a probability: "found" from 0.90, "probably" from 0.70, "may be" below, by the two digits shown."""
    shown = round(probability, 2)
    return "found" if shown >= FOUND else "probably" if shown >= PROBABLY else "may be"


def statements(
    added: Iterable[Effect],
    values: Mapping[str, float],
    probabilities: Mapping[str, float],
    rounds: Sequence[RoundReport],
    questions: Sequence[Question],
    settings: DiagnosisSettings,
) -> tuple[Statement, ...]:
    """A statement on each effect that was added.

    Args:
        added: effects at work in the final model, in the order found.
        values: parameters of that model, SI by symbol.
        probabilities: of the effects; an effect without one counts as proven.
        rounds, questions: the rounds of the diagnosis, and the question of each with its answers.
    """
    answers = {each.added: question.answers for each, question in zip(rounds, questions, strict=False)}
    return tuple(
        statement(e, Named.of_effect(e, values), probabilities.get(e.name, 1.0), answers.get(e.name, {}), settings)
        for e in added
    )


class Named(NamedTuple):
    """The name of an effect in a sentence."""

    called: str  # its name, or the mistake of the rig, its place and its size
    mend: str = ""  # the line of rig.toml that takes a mistake of the rig into account; "" of other effects

    @classmethod
    def of_effect(cls, effect: Effect, values: Mapping[str, float]) -> Named:
        """The name of an effect with its size in a fitted model, SI by symbol."""
        if not issubclass(effect, AbstractRigEffect):
            return cls(effect.name)
        first = parameters_of(effect)[0]
        size = float(values[first.symbol])
        shown = f"{size:.3g} {first.unit}" if first.unit else f"{100.0 * size:+.3g} %"
        return cls(f"{effect.called(size)} in {effect.place.words}: {shown}", effect.mend(size))


def statement(
    effect: Effect, named: Named, probability: float, answers: Mapping[str, float], settings: DiagnosisSettings
) -> Statement:
    """The statement on one effect; it is acted on where its probability is at least `suspicion`."""
    instead = dict(likely_hypotheses({e: p for e, p in answers.items() if e not in (effect.name, SOMETHING_ELSE)}))
    word, acted_on = certainty(probability), not round(probability, 2) < settings.suspicion
    if not named.mend:
        said = f"{_LACKED[word]} {named.called} ({probability:.2f})."
    else:
        said = f"{_MISTAKE[word]} ({probability:.2f}): {named.called}."
        said += f" To mend it, change in rig.toml: {named.mend}." if acted_on else ""
    said += "" if word == "found" else _to_measure(instead, effect.told_by)
    return Statement(effect.name, probability, word, acted_on, instead, effect.told_by, said)


def _to_measure(instead: Mapping[str, float], told_by: str) -> str:
    """The other explanations, and the measurement that would decide."""
    others = likely_in_one_line(instead)
    return f"{f' Other possible causes: {others}.' if others else ''} A measurement that would decide: {told_by}."


# ---- Mistakes of the rig, as opposed to effects that the model lacks, and their cure
#
# A mistake that is probable enough comes with the line of rig.toml that mends it, a suspicion with the measurement that
# would decide (`DiagnosisSettings.suspicion`).


def rig_mistakes(
    added: Sequence[Effect], values: Mapping[str, float], stated: Sequence[Statement]
) -> tuple[RigMistake, ...]:
    """The mistakes of the rig among the effects added."""
    return tuple(
        _mistake(e, values, each) for e, each in zip(added, stated, strict=True) if issubclass(e, AbstractRigEffect)
    )


def _mistake(effect: type[AbstractRigEffect], values: Mapping[str, float], stated: Statement) -> RigMistake:
    first, place = parameters_of(effect)[0], effect.place
    size = float(values[first.symbol])
    return RigMistake(
        effect=effect.name,
        kind=effect.called(size),
        test=place.test or None,
        channel=place.channel or None,
        size=size,
        unit=first.unit,
        mend=effect.mend(size),
        sentence=stated.sentence,
        file=place.file or None,
        suspected=not stated.acted_on,
    )


# ---- Whether the final model is kept, and the verdict of a diagnosis in a few sentences

_NOTHING = "The residual is noise: the model lacks nothing that these data show."


def runs_free_worse(after: FitResult, before: FitResult, settings: DiagnosisSettings) -> bool:
    """Whether the final model, run free, predicts held-out traces clearly worse than the first fit does.

    Where no traces are held out, the RMS of the fitted traces is compared. The comparison is needed because far from
    the data effects are judged by a guided residual, which a wrong effect may lower too.
    """
    end, beginning = (pooled(result.score_holdout or result.score_fit) for result in (after, before))
    return clearly_worse(end, beginning, settings.refit_rise)


def tie(found: Found) -> Tie:
    """The tie of an effect found with the effects that these data cannot tell from it."""
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
    """The verdict in a few sentences: the effects found and how sure they are, ties, and the remaining residual.

    Args:
        rounds: all rounds; the last one adds no effect unless the limit of rounds was reached.
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
        words.append("The residual is not all noise, but no effect that was tried explains the rest.")
    return tuple(words)
