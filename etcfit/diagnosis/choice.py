"""Decides which of the tried effects is added, from the numbers of their trials alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from ..estimation.identifiability import listed
from .composition import Effect, is_of_one_channel, is_of_the_rig
from .formula_errors import chi2_left_by_formula
from .score import Score
from .screen import Signature
from .settings import DiagnosisSettings
from .trial import Cost, TrialVerdict, required_bic_change

LEAST_PROMISE = 0.5  # share of the fall in -2 log likelihood that BIC requires, which the score test must promise
RIVAL_PROMISE = 0.3  # share of the largest promise of the round that another candidate must exceed
RIVAL_PROMISE_FAR = 0.1  # the same far from the data, where the promise of a linear model is rough
# fall of chi2 over what the effect leaves above the noise; one that explains less imitates something else
LEAST_PART = 0.2
LEAST_PART_OF_ONE = 1.0  # the same for an effect in one channel of one trace
TIED_LIKELIHOOD = 6.0  # difference in -2 log likelihood below which two effects explain the data equally well


class Outcome(Enum):
    """How a round ends."""

    ADDED = "an effect was added"
    NO_PROMISE = "no effect promises to explain anything more"
    NOT_WORTH_IT = "none is worth its parameters"
    CONTRADICTED = "none helps on the traces held out"
    SMALL_PART = "none explains enough of what it leaves"
    SPOILT = "refitted in full the model is worse"


@dataclass(frozen=True)
class Choice:
    """What a round adds."""

    outcome: Outcome  # how it ended
    effect: Effect | None  # the one added, or None
    ties: tuple[Effect, ...]  # others that explain these data as well
    why: str  # one sentence

    def with_refit_refused(self) -> Choice:
        """The choice where the full refit is worse than the model before: the effect is not added."""
        why = f"{self.why} A full refit with it leaves the model further from the data: it is not added."
        return replace(self, outcome=Outcome.SPOILT, effect=None, ties=(), why=why)


# ---- before any refit


def promises(g: Signature, cost: Cost, before: Score, settings: DiagnosisSettings) -> bool:
    """Whether the score test promises `LEAST_PROMISE` of the fall in -2 log likelihood that BIC requires."""
    required = cost.of_bic(before.count) - required_bic_change(settings, bool(before.errors))
    return bool(g.gain * before.likelihood_per_chi2 > LEAST_PROMISE * required)


def promising(
    signatures: Sequence[Signature],
    before: Score,
    far: bool,
    cost: Callable[[Effect], Cost],
    settings: DiagnosisSettings,
) -> list[Signature]:
    """The signatures worth a refit: those that promise enough by themselves and compared with the best of their kind.

    Effects of the rig are counted apart from effects of the throttle: they are many and alike, and together they would
    leave no refit for the throttle's. Effects of one channel of one trace are counted apart too, because each may
    promise as much as an effect of a whole test.
    """
    rival = RIVAL_PROMISE_FAR if far else RIVAL_PROMISE
    worth = []
    for of_the_rig in (False, True):
        kind = [g for g in signatures if is_of_the_rig(g.variant.effect) is of_the_rig]
        least = rival * max((g.gain for g in kind), default=0.0)
        strong = [g for g in kind if g.gain > least]
        good = [g for g in strong if promises(g, cost(g.variant.effect), before, settings)]
        worth += first_of(good, settings.rig_refits if of_the_rig else settings.refits, settings)
    return sorted(worth, key=lambda g: -g.gain)


def first_of(signatures: Sequence[Signature], most: int, settings: DiagnosisSettings) -> list[Signature]:
    """The first `most` signatures, and after them the first `rig_refits` of single channels of single traces.

    The latter are counted apart so that they leave room for simpler ones: in a test of one fitted trace both promise
    the same.
    """
    single = [g for g in signatures if is_of_one_channel(g.variant.effect)]
    others = [g for g in signatures if not is_of_one_channel(g.variant.effect)]
    return [*others[:most], *single[: settings.rig_refits]]


# ---- after a trial


def deserves_second_trial(v: TrialVerdict, far: bool, settings: DiagnosisSettings) -> bool:
    """Whether the held-out traces alone speak against an effect.

    Its refit may have ended in a local optimum, or the whitening of the model before may hold it there.
    """
    return not far and v.is_strong(settings) and explains_enough(v, v.samples) and not v.helps_elsewhere()


def is_accepted(v: TrialVerdict, settings: DiagnosisSettings) -> bool:
    """Whether an effect is worth its parameters and not contradicted by the held-out traces."""
    return v.is_strong(settings) and v.helps_elsewhere()


def choose(verdicts: Sequence[TrialVerdict], settings: DiagnosisSettings, noise: float = np.inf) -> Choice:
    """Which effect to add, which others explain the data equally well, and why.

    Args:
        verdicts: of the effects tried, the lowest BIC first.
        noise: chi2 of noise alone; an effect that explains little of the chi2 that it leaves above noise imitates
            another effect.
    """
    strong = [v for v in verdicts if v.is_strong(settings)]
    good = [v for v in strong if v.helps_elsewhere()]
    main = [v for v in good if explains_enough(v, noise)]
    return _added(main) if main else _none_added(good, strong, verdicts, settings)


def _none_added(
    good: Sequence[TrialVerdict],
    strong: Sequence[TrialVerdict],
    tried: Sequence[TrialVerdict],
    settings: DiagnosisSettings,
) -> Choice:
    """Why no effect is added: a sentence on the best of those that passed most of the tests."""
    outcome, why = Outcome.NO_PROMISE, "No effect of the catalogue promises to explain anything more."
    if good:
        outcome, v = Outcome.SMALL_PART, good[0]
        why = (
            f"{v.effect.name} is the best candidate, but explains less than {100 * least_part(v.effect):.0f} % of what "
            "it leaves: the model lacks something else."
        )
    elif strong:
        outcome = Outcome.CONTRADICTED
        why = f"{strong[0].effect.name} improves the fitted traces only, not the held-out ones."
    elif tried:
        outcome, v = Outcome.NOT_WORTH_IT, tried[0]
        why = (
            f"{v.effect.name} is the best candidate, but is not worth its parameters "
            f"(BIC {v.bic_change:+.1f}; {v.required_bic_change(settings):.0f} is required)."
        )
    return Choice(outcome, None, (), why)


def explains_enough(v: TrialVerdict, noise: float) -> bool:
    """Whether an effect explains its least part of what it leaves above the chi2 of noise alone."""
    return v.gain > least_part(v.effect) * (v.score.chi2 - noise)


def least_part(effect: Effect) -> float:
    """The least ratio of an effect's fall of chi2 to the chi2 that it leaves above noise.

    An effect of a single channel of a single trace must explain more than it leaves: there are hundreds of them, and an
    effect that the model lacks everywhere bends each trace in its own way."""
    return LEAST_PART_OF_ONE if is_of_one_channel(effect) else LEAST_PART


def in_turn(verdicts: Sequence[TrialVerdict], settings: DiagnosisSettings, noise: float = np.inf) -> tuple[Choice, ...]:
    """`choose`, then the choice without that effect, and so on while an effect is chosen."""
    choice = choose(verdicts, settings, noise)
    if choice.effect is None:
        return (choice,)
    rest = [v for v in verdicts if v.effect is not choice.effect]
    return (choice, *(c for c in in_turn(rest, settings, noise) if c.effect is not None))


def _added(main: Sequence[TrialVerdict]) -> Choice:
    best = main[0]
    ties = tuple(v.effect for v in main[1:] if alike(v, best))
    held = "" if best.holdout_rms_ratio is None else f", held-out error x {best.holdout_rms_ratio:.3f}"
    words = (
        f"{best.effect.name} explains most: fitted error x {best.fit_rms_ratio:.3f}{held}, BIC {best.bic_change:+.0f}."
    )
    if ties:
        words += f" {listed(e.name for e in ties)} would explain as much: these data cannot tell them apart."
    return Choice(Outcome.ADDED, best.effect, ties, words)


def alike(v: TrialVerdict, best: TrialVerdict) -> bool:
    """Whether two effects explain the data equally well: a tie.

        chi2_v - chi2_best < max(6 chi2_best / n, left)    or    BIC_v - BIC_best < 6

    n: independent samples; 6: `TIED_LIKELIHOOD`; left: chi2 that the less exact formula of the two may leave. Two
    effects are no tie where one is a mistake of the rig of a far less usual size (by 6 again, in -2 ln prior), however
    alike the fits are. An effect with fewer parameters may fit a little worse and be as likely: the second condition,
    on BIC alone, covers it. BIC chooses which of the two is put into the model; it does not prove that one.
    """
    left = chi2_left_by_formula(max(v.effect.inexact, best.effect.inexact), best.gain, best.samples)
    apart = v.score.chi2 - best.score.chi2
    fits = apart < left or apart * best.score.likelihood_per_chi2 < TIED_LIKELIHOOD
    usual = v.prior - best.prior < TIED_LIKELIHOOD
    return bool((fits and usual) or v.bic_change - best.bic_change < TIED_LIKELIHOOD)
