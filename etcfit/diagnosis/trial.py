"""The trial of one further effect, and the prior of a mistake of the rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..estimation.rounds import deviance
from ..model.parameters import parameters_of
from .candidate_model import CandidateModel
from .composition import Composition, Effect, is_of_one_channel, is_of_the_rig, resting
from .probabilities import BESIDE_FORMULAS
from .rig_screen import gain_in_one_event
from .score import Score, score
from .settings import DiagnosisSettings
from .tangents import variants

# ---- The prior of a mistake of the rig: the usual size of such a mistake, and whether the rig's checks found it.
#
#     -2 ln prior = 2 sum over amplitudes of ln(1 + (a / usual size)^2)    - 2 ln 10 where the checks found it
#                                                                         + 2 ln 25 in one channel of one trace
#
# A Cauchy density of the size, over its peak: a mistake of a usual size costs almost nothing, and a mistake of any size
# is possible. So where both explain the data equally well, a resistor of 1.2 ohm, which many rigs have, is preferred to
# a probe that reads 74 % too much, which is very rare; and an effect of a whole test is preferred to the same effect in
# its one fitted trace. The usual size is the scale of the parameter.
#
# Source: Berger 1985, Statistical Decision Theory, 4.7 (robust priors with flat tails). Differs from source: only the
# ratio to the density at zero is kept.


# held-out chi2 may rise by this share of the fall of chi2 of the fitted traces: held-out traces may not show the effect
SPARED_GAIN = 0.01
HELD_OUT_NOISE = 1.1  # whitened chi2 per held-out sample up to which nothing in it contradicts a model


_FOUND_BY_CHECKS = 10.0  # times as probable, before any fit, as a mistake that no check found

_IN_ONE_PLACE = 25.0  # factor by which it is less probable: there are hundreds of such places


def surprise(effect: Effect, values: Mapping[str, float], stated: Iterable[Effect]) -> float:
    """-2 ln prior of an effect of the rig at its size; 0 for an effect of the throttle.

    Args:
        values: of the model, SI by symbol.
        stated: effects that the rig's checks state.
    """
    if not is_of_the_rig(effect):
        return 0.0
    sizes = [values[p.symbol] / p.domain.scale for p in parameters_of(effect) if p.symbol in (effect.off or {})]
    unusual = 2.0 * float(np.sum(np.log1p(np.square(sizes))))
    place = 2.0 * float(np.log(_IN_ONE_PLACE)) if is_of_one_channel(effect) else 0.0
    return unusual + place - (2.0 * float(np.log(_FOUND_BY_CHECKS)) if effect in stated else 0.0)


# ---- The trial of one further effect: refitted, and judged on the fitted and on the held-out traces
#
# Two models are compared under one whitening and one set of weights, those of the model before the trial, so that their
# chi2 differ only by what they explain:
#
#     BIC change = n ln(chi2_1 / chi2_0) + (k_1 - k_0) ln n + 2 ln(variants tried) - 2 ln prior
#
# with n the number of independent samples and the prior that of a mistake of the rig (`surprise`). Where effects with
# inexact formulas are at work chi2 is r^T M^-1 r (`formula_errors`). M does not describe how a formula error changes
# within a stretch, so that `BESIDE_FORMULAS` times the evidence is required there.
#
# An amplitude that cannot be negative and is best at zero gains nothing: the test is one-sided by construction.
#
# For an effect of the rig that is late, only the gain outside one event counts. A lateness changes every part of a
# trace; but where the instant of a single edge was not logged, a small delay often fits the response to it better, and
# no other trace can contradict the lateness of one trace.


def is_noise(held_out: float | None, samples: float) -> bool:
    """Whether held-out samples, each predicted from those before it, differ from a model by noise alone.

    Args:
        held_out: their chi2.
    """
    return held_out is not None and held_out < HELD_OUT_NOISE * samples


def required_bic_change(settings: DiagnosisSettings, beside_formulas: bool) -> float:
    """Change of BIC below which an effect is worth its parameters; beside effects with inexact formulas it is lower."""
    return settings.strong_bic_change * (BESIDE_FORMULAS if beside_formulas else 1.0)


@dataclass(frozen=True)
class TrialVerdict:
    """The numbers by which a model with one further effect is compared with the model before."""

    effect: Effect  # the effect tried
    score: Score  # score of the model with it
    samples: float  # number of fitted samples
    # fit_rms_ratio, holdout_rms_ratio: free-run RMS over that without it; the latter None without a holdout
    fit_rms_ratio: float
    holdout_rms_ratio: float | None
    # change of chi2 of the held-out traces, or of traces left out in turn; None without either
    holdout_chi2_change: float | None
    bic_change: float  # below 0 where it is worth its parameters
    gain: float  # by how much it lowers chi2 of the fitted traces
    slack: float  # allowed relative rise of the held-out free-run RMS
    prior: float = 0.0  # -2 ln prior, a part of `bic_change`
    beside_formulas: bool = False  # whether effects with inexact formulas are at work in the model before
    held_out_noise: bool = False  # whether the model with it predicts held-out samples from those before them to noise

    def required_bic_change(self, settings: DiagnosisSettings) -> float:
        """Change of BIC below which the effect is worth its parameters."""
        return required_bic_change(settings, self.beside_formulas)

    def is_strong(self, settings: DiagnosisSettings) -> bool:
        """Whether BIC falls by enough for the effect to be worth its parameters."""
        return self.bic_change < self.required_bic_change(settings)

    def helps_elsewhere(self) -> bool:
        """Whether held-out traces do not contradict the effect. They need not show it: for example, not every trace
        reaches a stop. A free run adds up what the noise of the input does: where it is worse but every held-out
        sample, predicted from those before it, differs by noise alone, nothing contradicts the effect."""
        spared = self.holdout_chi2_change is None or self.holdout_chi2_change < SPARED_GAIN * self.gain
        near = self.holdout_rms_ratio is None or self.holdout_rms_ratio < 1.0 + self.slack
        return spared and (near or self.held_out_noise)


@dataclass(frozen=True, eq=False)
class Trial:
    """A refitted model and the verdict on it."""

    model: CandidateModel = field(repr=False)
    verdict: TrialVerdict


class Cost(NamedTuple):
    """The BIC cost of an effect: the parameters that it frees, and the variants from which it was chosen."""

    parameters: int
    variants: int

    @classmethod
    def of_effect(cls, effect: Effect, composition: Composition) -> Cost:
        """The cost of an effect. The variants of an effect of the rig are the places where a rig may be wrong; whole
        tests and traces come first, so that only a channel of one trace counts all such channels too."""
        among = composition.of_the_rig if is_of_the_rig(effect) else ()
        places = sum(is_of_one_channel(effect) or not is_of_one_channel(other) for other in among)
        return cls(len(resting(effect)), len(variants(effect)) * max(places, 1))

    def of_bic(self, count: float) -> float:
        """k ln n + 2 ln(variants): the rise of BIC where the effect explains nothing; n independent samples."""
        return float(self.parameters * np.log(count) + 2.0 * np.log(max(self.variants, 1)))


def bic_change(before: Score, after: Score, cost: Cost) -> float:
    """n ln(chi2_1 / chi2_0) + (k_1 - k_0) ln n + 2 ln(variants), n the smaller of both counts, at least 2."""
    n = max(2.0, min(before.count, after.count))
    return float(n * np.log(after.chi2 / before.chi2)) + cost.of_bic(n)


def compare(
    effect: Effect, before: Score, after: Score, cost: Cost, samples: float = np.inf, slack: float = 0.0
) -> TrialVerdict:
    """The verdict on a model with one further effect, from the scores without and with it."""
    held_out = None
    if after.held_out is not None and before.held_out is not None:
        held_out = after.held_out - before.held_out
    ratio = None
    if after.holdout_rms is not None and before.holdout_rms is not None:
        ratio = after.holdout_rms / before.holdout_rms
    change = bic_change(before, after, cost)
    fit_ratio = after.fit_rms / before.fit_rms
    gain = before.chi2 - after.chi2
    return TrialVerdict(
        effect, after, samples, fit_ratio, ratio, held_out, change, gain, slack, beside_formulas=bool(before.errors)
    )


def judge_trial(effect: Effect, before: Score, s: CandidateModel, cost: Cost | None = None) -> Trial:
    """The trial of a refitted model that has one more effect than the one scored before."""
    slack, after = s.settings.rise_in_trial(s.far), score(s, before.errors)
    counted = after
    if is_of_the_rig(effect) and effect.delays and s.at_work(effect):
        counted = replace(after, chi2=after.chi2 + gain_in_one_event(s, effect))
    verdict = compare(effect, before, counted, cost or Cost.of_effect(effect, s.composition), s.weighted.samples, slack)
    prior = surprise(effect, s.values, s.composition.stated) if s.at_work(effect) else 0.0
    noise = not s.far and s.holdout is not None and is_noise(after.held_out, s.holdout[1].samples)
    bic = verdict.bic_change + prior
    return Trial(s, replace(verdict, score=after, bic_change=bic, prior=prior, held_out_noise=noise))


def run_trial(s: CandidateModel, effect: Effect, values: Mapping[str, float], before: Score) -> Trial:
    """The trial of an effect that starts at `values` (SI by symbol), added to a model scored before."""
    return judge_trial(effect, before, s.trying((effect,), values).optimised())


def second_trial(first: Trial, full: CandidateModel, s: CandidateModel, before: Score) -> Trial:
    """The second trial of an effect that the held-out traces contradicted: they judge the model of a full refit, with
    the rise that is allowed there.

    The whitening of the model before can make the chi2 of either model too large: it knows nothing of an impact that
    the effect moves. So the fitted traces judge the better of both models, and the held-out ones contradict the effect
    only if their -2 log L, each model by its own whitening, rises too.

    Args:
        s: the model before, scored as `before`.
    """
    again = judge_trial(first.verdict.effect, before, replace(first.model, x=full.x))
    best = min(first, again, key=lambda t: t.verdict.score.chi2)
    change = again.verdict.holdout_chi2_change
    if change is not None and full.holdout is not None and s.holdout is not None and not full.far:
        change = min(change, deviance(*full.holdout, full.x) - deviance(*s.holdout, s.x))
    verdict = replace(
        best.verdict,
        holdout_rms_ratio=again.verdict.holdout_rms_ratio,
        holdout_chi2_change=change,
        held_out_noise=again.verdict.held_out_noise,
        slack=full.settings.refit_rise,
    )
    return replace(best, verdict=verdict)
