"""What a diagnosis states of each name: how sure it is, what else could explain the same, which measurement would tell.

One place has the words; terminal, pages and closing lines print the sentence of a statement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .composition import Effect
from .findings import Question, RoundReport, Statement
from .likely import in_words, likely
from .probabilities import SOMETHING_ELSE
from .settings import DiagnosisSettings

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
        settings: `suspicion`.
    """
    answers = {each.added: question.answers for each, question in zip(rounds, asked, strict=False)}
    return tuple(
        statement(e, Named.of(e, values), probabilities.get(e.name, 1.0), answers.get(e.name, {}), settings)
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
    def of(cls, effect: Effect, values: Mapping[str, float]) -> Named:
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
    """On one effect; it is acted on where it is at least as probable as `suspicion` asks.

    Args:
        effect, named: the effect, and its words.
        probability: that it is there.
        answers: of the round that added it.
        settings: `suspicion`.
    """
    instead = dict(likely({e: p for e, p in answers.items() if e not in (effect.name, SOMETHING_ELSE)}))
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
    others = in_words(instead)
    return f"{f' What else could be: {others}.' if others else ''} What would tell: {told_by}."
