"""Computes the probability that each effect is really present, and which effects of the final model are named.

    questions, probabilities            for each round, which effect explains the misfit; over all rounds, which exist
    named_effects                       effects stated by name, and those in doubt, which stay in the model unnamed
    likely_hypotheses                   hypotheses that are probable enough to be printed

`course` calls it at the end of a diagnosis, with the reports of the rounds; `statements` and the pages print it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from ..model.rig_effects import rig_effect
from .credit import (
    BESIDE_A_MISFIT,
    credit_by_round,
    held_out_share,
    largest_probability,
    leaves_more_than_noise,
    left_share,
)
from .findings import Candidate, Question, RoundReport
from .settings import DiagnosisSettings

BIC_TEMPER = 10.0  # by how much a change of BIC overstates its evidence
BESIDE_FORMULAS = 7.0  # factor of the required change of BIC where effects with inexact formulas are at work

# ---- What is probable enough to be printed: one list for statements, terminal and pages

_PRINTED_FROM = 0.02
WORTH_NAMING = 0.2  # probability, including that of its ties, from which on an effect is stated by name
LIKELIER_THAN_NOT = 0.5  # the same where something without a name is at least as likely as this


def likely_hypotheses(probabilities: Mapping[str, float | None]) -> list[tuple[str, float]]:
    """Hypotheses probable enough to be printed, the likeliest first."""
    worth = ((name, p) for name, p in probabilities.items() if p and p >= _PRINTED_FROM)
    return sorted(worth, key=lambda each: (each[1], each[0]), reverse=True)


def likely_in_one_line(probabilities: Mapping[str, float | None]) -> str:
    """The likely hypotheses in one line, "" where there are none."""
    return ", ".join(f"{name} {p:.2f}" for name, p in likely_hypotheses(probabilities))


# ---- How likely is each explanation: questions with answers that exclude each other, and P(effect | data) from them
#
# The question of every round is which effect explains the misfit. Each effect refitted is compared with "nothing" by
# Schwarz's approximation of the Laplace evidence,
#
#     w_e = prior_e exp(-change of BIC / (2 T)),    w_nothing = 1,    p_e = (1 - lapse) w_e / sum of all w
#
# T tempers it: correlated residuals make BIC surer than it should be. Beside effects with inexact formulas it is
# `BESIDE_FORMULAS` times as large for effects that have the evidence which `trial` requires there. The prior
# (`trial.surprise`, which the change of BIC leaves out here) is not tempered. `lapse` is the probability of the answer
# "something else": the rate at which a name is wrong however strong its evidence is, because the true cause may be
# outside the catalogue; it is higher where an effect explains only a part of the misfit at its place
# (`credit_by_round`), and by the limits of `largest_probability`. The answers of a question add up to one.
# An effect is absent only if it is absent in every round. The calibration of these probabilities:
# docs/validation/bank.md.
#
# A mistake of the rig changes the data exactly as its formula says: a model that knows it leaves noise. Where it leaves
# more, another cause is at work, which the mistake may only imitate.
#
# Source: Kass and Raftery 1995, eq. 9 (BIC as evidence). Differs from source: tempered, and with a lapse.

NOTHING, UNEXPLAINED, SOMETHING_ELSE = "nothing", "unexplained", "something else"
BETWEEN_SAMPLES = "what acted between two samples of a slow log"
NO_NAME, ONLY_NOISE = "something without a name", "noise or inexact formulas alone"
CALIBRATED = (
    "In 167 synthetic folders 104 of 105 names stated with 0.80 or more were right; 0.90 is the most that is stated "
    "(docs/validation/bank.md)."
)


def questions(
    rounds: Sequence[RoundReport],
    added: Collection[str],
    curve: bool,
    settings: DiagnosisSettings,
    slow: bool = False,
    doubts: Collection[str] = (),
    corrected: Collection[str] = (),
) -> tuple[Question, ...]:
    """The question of each round with its answers, and a last question on the misfit left at the end.

    Where a log is too slow for the dynamics in it (`rig.checks.lags`), that may explain any misfit: each question then
    has this further answer, of probability `slow_log`.

    Args:
        added: the effects of the final model that are not in doubt.
        curve: whether a curve without a name was found.
        slow: whether a fitted test was logged too slowly.
        doubts: other effects of that model, for which another cause is likelier (`doubted_effects`).
        corrected: effects whose formulas the curve corrects: it is then no sign of an effect without a name.
    """
    gone = _withdrawn(rounds, added)
    limits = (largest_probability(each.added, rounds, curve, settings) for each in rounds)
    credit = credit_by_round(rounds, {*added, *doubts}, corrected)
    believed = [min(pair) for pair in zip(credit, limits, strict=True)]
    round_questions = [
        Question(f"Round {k}: which effect explains the residual?", _answers(each, gone, most, settings))
        for k, (each, most) in enumerate(zip(rounds, believed, strict=True), start=1)
    ]
    left = _probability_of_unnamed_rest(rounds, added, curve and not corrected, doubts, settings)
    every = (
        *round_questions,
        Question("At the end: what explains the remaining residual?", {ONLY_NOISE: 1.0 - left, NO_NAME: left}),
    )
    if not slow:
        return every
    return tuple(
        Question(
            each.asks,
            {a: (1.0 - settings.slow_log) * p for a, p in each.answers.items()} | {BETWEEN_SAMPLES: settings.slow_log},
        )
        for each in every
    )


class NamedEffects(NamedTuple):
    """Which effects of a model are stated by name, and how sure each is."""

    names: tuple[str, ...]  # effects that are stated, in the order found
    # effects that are not stated: another cause is likelier, or they are too improbable
    doubts: tuple[str, ...]
    # questions, probabilities: as returned by the functions of these names
    questions: tuple[Question, ...]
    probabilities: Mapping[str, float]


def named_effects(
    rounds: Sequence[RoundReport],
    present: Sequence[str],
    doubts: Sequence[str],
    curve: bool,
    settings: DiagnosisSettings,
    slow: bool,
    corrected: Collection[str] = (),
) -> NamedEffects:
    """Decide which effects of the final model are stated by name, and how sure each is.

    Beside a log that is too slow for its input, an effect of the throttle is stated only if what the model leaves is
    noise alone: what acted between the samples explains a misfit as well.

    Args:
        rounds, curve, settings, slow, corrected: as of `questions`.
        present: effects of the final model, in the order found.
        doubts: those of them for which another cause is likelier (`doubted_effects`).
    """
    names = tuple(name for name in present if name not in doubts)
    round_questions = questions(rounds, names, curve, settings, slow, doubts, corrected)
    chance = probabilities(round_questions, rounds, names, curve, settings, doubts)
    alike = {str(each.added): (str(each.added), *each.ties) for each in rounds}
    likely = {n: sum(chance.get(e, 0.0) for e in alike.get(n, (n,))) for n in names if n in chance}
    silent = slow and leaves_more_than_noise(rounds)
    least = max(WORTH_NAMING, min(LIKELIER_THAN_NOT, chance[UNEXPLAINED]))
    unlikely = [name for name, p in likely.items() if p < least or (silent and rig_effect(name) is None)]
    if unlikely:
        return named_effects(rounds, present, (*doubts, *unlikely), curve, settings, slow, corrected)
    return NamedEffects(names, tuple(doubts), round_questions, chance)


def probabilities(
    round_questions: Sequence[Question],
    rounds: Sequence[RoundReport],
    added: Collection[str],
    curve: bool,
    settings: DiagnosisSettings,
    doubts: Collection[str] = (),
) -> Mapping[str, float]:
    """The probability of every effect that was refitted, of "nothing" and of "unexplained", each from 0 to 1.

    The hypotheses do not exclude each other: two effects may both be present. "nothing" means that the model lacks no
    effect which these data show; fainter effects may be present.

    Args:
        round_questions: the questions of these rounds, with their answers.
        rounds, added, curve, settings, doubts: as of `questions`.
    """
    *of_rounds, at_last = round_questions
    named: dict[str, float] = {}
    for each in of_rounds:
        for effect, p in each.answers.items():
            if effect not in (NOTHING, SOMETHING_ELSE, BETWEEN_SAMPLES):
                named[effect] = 1.0 - (1.0 - named.get(effect, 0.0)) * (1.0 - p)
    # an effect that was taken away again, or is in doubt, counts as one that was never added
    named |= {effect: min(named.get(effect, 1.0), settings.missed) for effect in _withdrawn(rounds, added)}
    silent = not (added or curve or doubts) and rounds[0].evidence.white
    return {
        **dict(sorted(named.items(), key=lambda item: -item[1])),
        NOTHING: 1.0 - settings.missed if silent else settings.lapse * math.prod(1.0 - p for p in named.values()),
        UNEXPLAINED: at_last.answers[NO_NAME],
    }


def with_effect_before_rounds(name: str, probability: float, found: Mapping[str, float]) -> Mapping[str, float]:
    """`found` with an effect of this probability that was found before the rounds; that of "nothing" is multiplied by
    the rest."""
    return {name: probability, **found, NOTHING: (1.0 - probability) * found[NOTHING]}


def _withdrawn(rounds: Sequence[RoundReport], added: Collection[str]) -> set[str]:
    """Effects that a round added and that are in doubt or not in the final model."""
    return {each.added for each in rounds if each.added is not None} - set(added)


def _probability_of_unnamed_rest(
    rounds: Sequence[RoundReport],
    added: Collection[str],
    curve: bool,
    doubts: Collection[str],
    settings: DiagnosisSettings,
) -> float:
    """Probability that something without a name is left at the end; `curve`: one that corrects no formula."""
    last = rounds[-1] if added else rounds[0]  # where all were taken away again, the first model is the final one
    noise = last.evidence.white and not doubts
    if curve or not (added or noise):
        return 1.0 - settings.lapse
    if noise and not added:
        return settings.missed
    imitated = not noise and leaves_more_than_noise(rounds) and any(rig_effect(name) is not None for name in added)
    least = 1.0 - BESIDE_A_MISFIT if imitated else settings.lapse
    astray = 0.0 if all(rig_effect(name) is not None for name in added) else 1.0 - held_out_share(rounds)
    return min(max(left_share(rounds, doubts), astray, least), 1.0 - settings.lapse)


def _answers(
    each: RoundReport, withdrawn: Collection[str], most: float, settings: DiagnosisSettings
) -> Mapping[str, float]:
    """Probabilities of the effects refitted in one round, "nothing" and "something else": they add up to one.

    In a round that added an effect, the accepted effects and "nothing" have the sum `most`, and effects that the
    held-out traces contradict have 0. In a round that added none, all effects and "something else" have the sum
    `missed`. An effect that was taken away again has `missed` at most; the rest of its probability goes to "something
    else".
    """
    refitted = [c for c in each.candidates if c.bic_change is not None]
    added = [c for c in refitted if c.effect == each.added]

    def behind_added(rival: Candidate) -> float:
        temper = _temper(rival, each, settings)
        return _tempered(rival, temper) - sum(_tempered(c, temper) for c in added)

    behind = {c.effect: behind_added(c) for c in refitted}
    weights = {e: math.exp(-0.5 * max(0.0, apart)) for e, apart in behind.items()}
    if each.added is None:
        named = {e: settings.missed * w / (sum(weights.values()) + 1.0) for e, w in weights.items()}
        return {**named, NOTHING: 1.0 - settings.missed, SOMETHING_ELSE: settings.missed - sum(named.values())}
    standing = {e: w for e, w in weights.items() if e == each.added or e in each.ties or behind[e] >= 0.0}
    nothing = math.exp(0.5 * min([0.0, *(_tempered(c, _temper(c, each, settings)) for c in added)]))
    share = most / (sum(standing.values()) + nothing)
    named = {e: share * standing.get(e, 0.0) for e in weights}
    named |= {e: min(named[e], settings.missed) for e in withdrawn if e in named}
    return {**named, NOTHING: share * nothing, SOMETHING_ELSE: 1.0 - sum(named.values()) - share * nothing}


def _temper(tried: Candidate, each: RoundReport, settings: DiagnosisSettings) -> float:
    """T of an effect: larger where it has the evidence required beside inexact formulas, and held-out traces do not
    contradict it."""
    strong = (tried.bic_change or 0.0) < settings.strong_bic_change * BESIDE_FORMULAS
    contradicted = (tried.holdout_chi2_change or 0.0) > 0.0
    counts = each.beside_formulas and (tried.effect == each.added or (strong and not contradicted))
    return BIC_TEMPER * (BESIDE_FORMULAS if counts else 1.0)


def _tempered(tried: Candidate, temper: float) -> float:
    """-2 ln w of an effect that was refitted: its evidence tempered, its prior as it is."""
    prior = tried.prior or 0.0
    return ((tried.bic_change or 0.0) - prior) / temper + prior
