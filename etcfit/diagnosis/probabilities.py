"""How likely is each explanation: questions with answers that exclude each other, and P(effect | data) from them.

Every round asks what explains what is left of the residual. Each effect refitted competes with "nothing" by Schwarz's
approximation of the Laplace evidence,

    w_e = prior_e exp(-change of BIC / (2 T)),    w_nothing = 1,    p_e = (1 - lapse) w_e / sum of all w

T tempers it: residuals that are not white, and formulas that are not exact, make BIC surer than it should be; what was
known before the data (`prior.py`, which the change of BIC leaves out here) is not tempered. `lapse`
is the answer "something else": how often a name is wrong however strong its evidence, for the truth may lie outside
the catalogue; more, where a name answers for less than all that is missing where it acts (`credit.py`). The answers of
a question add up to one. Over rounds an effect is there unless none of them puts it there. How well they are
calibrated: docs/validation/bank.md.

Source: Kass and Raftery 1995, eq. 9 (BIC as evidence). Differs from source: tempered, and with a lapse.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from .credit import credits, left_share
from .findings import Question, RoundReport
from .settings import DiagnosisSettings

NOTHING, UNEXPLAINED, SOMETHING_ELSE = "nothing", "unexplained", "something else"
BETWEEN_SAMPLES = "what acted between two samples of a slow log"
NO_NAME, ONLY_NOISE = "something without a name", "noise, or no more than inexact formulas leave"
CALIBRATED = (
    "On 80 synthetic folders 85 % of the names stated with 0.80 or more were right; 0.90 is the most that is stated "
    "(docs/validation/bank.md)."
)


def questions(
    rounds: Sequence[RoundReport],
    added: Collection[str],
    curve: bool,
    settings: DiagnosisSettings,
    slow: bool = False,
    doubts: Collection[str] = (),
) -> tuple[Question, ...]:
    """What each round asked, and at last what is left without a name.

    Where a log is slower than what acts in it (`rig.checks.lags`), any misfit may be of that: it is one answer more to
    each question, of probability `slow_log`.

    Args:
        rounds: of the diagnosis.
        added: the effects that are in its final model and not in doubt.
        curve: whether a curve without a name was found.
        settings: `bic_temper`, `lapse`, `missed` and `slow_log`.
        slow: whether a fitted test was logged so.
        doubts: other effects of that model, which something else outdoes (`credit.doubted`).
    """
    gone = _withdrawn(rounds, added)
    believed = [min(each, 1.0 - settings.lapse) for each in credits(rounds, {*added, *doubts})]
    asked = [
        Question(f"Round {k}: what explains what is left of the residual?", _answers(each, gone, most, settings))
        for k, (each, most) in enumerate(zip(rounds, believed, strict=True), start=1)
    ]
    left = _left(rounds, bool(added), curve, doubts, settings)
    every = (*asked, Question("At the end: what is left?", {ONLY_NOISE: 1.0 - left, NO_NAME: left}))
    return tuple(_beside_a_slow_log(each, settings) for each in every) if slow else every


class Said(NamedTuple):
    """What is said of the effects in a model.

    Args:
        names: that are said, in the order found.
        doubts: that are not: something else is likelier, or they are less likely than something that was missed.
        questions, probabilities: see the functions.
    """

    names: tuple[str, ...]
    doubts: tuple[str, ...]
    questions: tuple[Question, ...]
    probabilities: Mapping[str, float]


def said(
    rounds: Sequence[RoundReport],
    present: Sequence[str],
    doubts: Sequence[str],
    curve: bool,
    settings: DiagnosisSettings,
    slow: bool,
) -> Said:
    """Which names are said, and how sure.

    Args:
        rounds, curve, settings, slow: as of `questions`.
        present: effects of the final model, in the order found.
        doubts: those of them that something else outdoes (`credit.doubted`).
    """
    names = tuple(name for name in present if name not in doubts)
    asked = questions(rounds, names, curve, settings, slow, doubts)
    chance = probabilities(asked, rounds, names, curve, settings, doubts)
    unlikely = [name for name in names if chance.get(name, 1.0) < settings.missed]
    if unlikely:
        return said(rounds, present, (*doubts, *unlikely), curve, settings, slow)
    return Said(names, tuple(doubts), asked, chance)


def _beside_a_slow_log(question: Question, settings: DiagnosisSettings) -> Question:
    answers = {answer: (1.0 - settings.slow_log) * p for answer, p in question.answers.items()}
    return Question(question.asks, {**answers, BETWEEN_SAMPLES: settings.slow_log})


def probabilities(
    asked: Sequence[Question],
    rounds: Sequence[RoundReport],
    added: Collection[str],
    curve: bool,
    settings: DiagnosisSettings,
    doubts: Collection[str] = (),
) -> Mapping[str, float]:
    """Of every effect that was refitted, of "nothing" and of "unexplained", each from 0 to 1.

    They are those of statements that do not exclude each other: two effects may both be there. "nothing" says that
    nothing is missing which these data show: what is too faint for them is not denied.

    Args:
        asked: the questions of these rounds, with their answers.
        rounds, added, curve, settings, doubts: as of `questions`.
    """
    *of_rounds, at_last = asked
    named: dict[str, float] = {}
    for each in of_rounds:
        for effect, p in each.answers.items():
            if effect not in (NOTHING, SOMETHING_ELSE, BETWEEN_SAMPLES):
                named[effect] = 1.0 - (1.0 - named.get(effect, 0.0)) * (1.0 - p)
    # what was taken away again, or is in doubt, is no more than what was never added
    named |= {effect: min(named.get(effect, 1.0), settings.missed) for effect in _withdrawn(rounds, added)}
    silent = not (added or curve or doubts) and rounds[-1].evidence.white
    return {
        **dict(sorted(named.items(), key=lambda item: -item[1])),
        NOTHING: 1.0 - settings.missed if silent else settings.lapse * math.prod(1.0 - p for p in named.values()),
        UNEXPLAINED: at_last.answers[NO_NAME],
    }


def besides(name: str, found: Mapping[str, float], settings: DiagnosisSettings) -> Mapping[str, float]:
    """The same where something else was proven before the rounds: it is there but for a lapse, and "nothing" is not."""
    return {name: 1.0 - settings.lapse, **found, NOTHING: settings.lapse * found[NOTHING]}


def _withdrawn(rounds: Sequence[RoundReport], added: Collection[str]) -> set[str]:
    """Effects that a round added and that are not in the final model, or in doubt."""
    return {each.added for each in rounds if each.added is not None} - set(added)


def _left(
    rounds: Sequence[RoundReport], named: bool, curve: bool, doubts: Collection[str], settings: DiagnosisSettings
) -> float:
    """Probability that something is left which has no name."""
    noise, unread = rounds[-1].evidence.white and not doubts, not rounds[-1].candidates and not doubts
    if curve or not (named or noise):
        return 1.0 - settings.lapse
    if noise:
        return settings.lapse if named else settings.missed
    if unread:  # a last round without candidates found no more than the formulas of what was named may leave
        return settings.lapse
    return min(max(left_share(rounds, doubts), settings.lapse), 1.0 - settings.lapse)


def _answers(
    each: RoundReport, withdrawn: Collection[str], most: float, settings: DiagnosisSettings
) -> Mapping[str, float]:
    """Of the effects refitted in one round, "nothing" and "something else": they add up to one.

    Effects and "nothing" get no more than `most`. Effects that the held-out traces contradict get nothing, as those
    that are not worth their parameters get no more than `missed` all together. One that was taken away again leaves
    what exceeds `missed` to something else.
    """
    changes = {c.effect: _tempered(c.bic_change, c.prior or 0.0, settings)
               for c in each.candidates if c.bic_change is not None}  # fmt: skip
    best = changes.get(each.added, 0.0) if each.added is not None else 0.0
    weights = {e: math.exp(0.5 * (best - max(b, best))) for e, b in changes.items()}
    if each.added is None:
        named = {e: settings.missed * w / (sum(weights.values()) + 1.0) for e, w in weights.items()}
        return {**named, NOTHING: 1.0 - sum(named.values()), SOMETHING_ELSE: 0.0}
    standing = {e: w for e, w in weights.items() if e == each.added or e in each.ties or changes[e] >= best}
    nothing = math.exp(0.5 * min(best, 0.0))
    share = most / (sum(standing.values()) + nothing)
    named = {e: share * standing.get(e, 0.0) for e in changes}
    named |= {e: min(named[e], settings.missed) for e in withdrawn if e in named}
    return {**named, NOTHING: share * nothing, SOMETHING_ELSE: 1.0 - sum(named.values()) - share * nothing}


def _tempered(bic_change: float, prior: float, settings: DiagnosisSettings) -> float:
    """-2 ln w of an effect: its evidence tempered, its prior as it is."""
    return (bic_change - prior) / settings.bic_temper + prior
