"""What a diagnosis states: each name and how sure it is, mistakes of the rig and their cure, and the verdict."""

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

# ---- What a diagnosis states of each name: how sure it is, what else could explain the same, which measurement would
# tell
#
# One place has the words; terminal, pages and closing lines print the sentence of a statement.


FOUND, PROBABLY = 0.9, 0.7
_LACKED = {"found": "Found: the model lacked", "probably": "Probably the model lacked", "may be": "The model may lack"}
_MISTAKE = {"found": "Found: a mistake of the rig", "probably": "Probably a mistake of the rig",
            "may be": "There may be a mistake of the rig"}  # fmt: skip


def certainty(probability: float) -> str:
    """ "found" from 0.90, "probably" from 0.70, "may be" below, by the two digits that are shown."""
    shown = round(probability, 2)
    return "found" if shown >= FOUND else "probably" if shown >= PROBABLY else "may be"


def statements(
    added: Iterable[Effect],
    values: Mapping[str, float],
    probabilities: Mapping[str, float],
    rounds: Sequence[RoundReport],
    asked: Sequence[Question],
    settings: DiagnosisSettings,
) -> tuple[Statement, ...]:
    """A statement on each effect that was added.

    Args:
        added: effects at work in the final model, in the order found.
        values: of that model, SI by symbol.
        probabilities: of the effects; one without any is taken as proven.
        rounds: of the diagnosis, and what each `asked`.
    """
    answers = {each.added: question.answers for each, question in zip(rounds, asked, strict=False)}
    return tuple(
        statement(e, Named.of_effect(e, values), probabilities.get(e.name, 1.0), answers.get(e.name, {}), settings)
        for e in added
    )


class Named(NamedTuple):
    """An effect in words.

    Args:
        called: its name, or the mistake of the rig, its place and its size.
        mend: the line of rig.toml that takes a mistake of the rig into account; "" of other effects.
    """

    called: str
    mend: str = ""

    @classmethod
    def of_effect(cls, effect: Effect, values: Mapping[str, float]) -> Named:
        """With the size that it has in a fitted model, SI by symbol."""
        if not issubclass(effect, AbstractRigEffect):
            return cls(effect.name)
        first = parameters_of(effect)[0]
        size = float(values[first.symbol])
        shown = f"{size:.3g} {first.unit}" if first.unit else f"{100.0 * size:+.3g} %"
        return cls(f"{effect.called(size)} in {effect.place.words}: {shown}", effect.mend(size))


def statement(
    effect: Effect, named: Named, probability: float, answers: Mapping[str, float], settings: DiagnosisSettings
) -> Statement:
    """On one effect; it is acted on where it is at least as probable as `suspicion` asks."""
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
    """What else could be, and which measurement would tell."""
    others = likely_in_one_line(instead)
    return f"{f' What else could be: {others}.' if others else ''} What would tell: {told_by}."


# ---- What the diagnosis found to be wrong with the rig rather than lacking in the model, and what to do about it
#
# A mistake that is likely enough comes with the line of rig.toml that mends it, a suspicion with the measurement that
# would tell (`DiagnosisSettings.suspicion`).


def rig_mistakes(
    added: Sequence[Effect], values: Mapping[str, float], stated: Sequence[Statement]
) -> tuple[RigMistake, ...]:
    """Of the effects added those that are the rig's."""
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


# ---- The last word of a diagnosis: whether its final model is kept, and the whole in a few sentences

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
        rounds: all of them, the last of which adds nothing unless they ran out.
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
