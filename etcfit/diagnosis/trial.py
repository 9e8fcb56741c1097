"""One effect more on trial, and what is known of a mistake of the rig before its likelihood is asked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..model.parameters import parameters_of
from .candidate_model import CandidateModel
from .composition import Composition, Effect, is_of_one_channel, is_of_the_rig, resting
from .rig_screen import gain_in_one_event
from .score import Score, score
from .settings import DiagnosisSettings
from .tangents import variants

# ---- What is known of a mistake of the rig before its likelihood is asked: how large such a mistake usually is, and
# whether the rig's checks found it.
#
#     -2 ln prior = 2 sum over amplitudes of ln(1 + (a / usual size)^2)    - 2 ln 10 where the checks found it
#                                                                         + 2 ln 25 in one channel of one trace
#
# A Cauchy density of the size, over its peak: a mistake of a usual size pays next to nothing, and one of any size may
# be there. So a resistor of 1.2 ohm, which many rigs have, goes before a probe that reads 74 % too much, which none
# has, where both explain the data alike; and what a whole test shows is not put down to its one fitted trace. The usual
# size is the scale of the parameter.
#
# Source: Berger 1985, Statistical Decision Theory, 4.7 (robust priors with flat tails). Differs from source: only the
# ratio to the density at zero is kept.


# held-out chi2 may rise by this share of what chi2 of the fitted traces falls: they may not show the effect
SPARED_GAIN = 0.01


_FOUND_BY_CHECKS = 10.0  # times as probable, before any fit, as a mistake of which no check says anything

_IN_ONE_PLACE = 25.0  # times less probable: one of hundreds of such places


def surprise(effect: Effect, values: Mapping[str, float], stated: Iterable[Effect]) -> float:
    """-2 ln prior of an effect of the rig at its size; 0 of an effect of the throttle.

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


# ---- One effect more on trial: refitted, and judged on what was fitted and on what was not
#
# Two models are compared under one whitening and one set of weights, those of the model before the trial, so that their
# chi2 differ by what they explain and by nothing else:
#
#     BIC change = n ln(chi2_1 / chi2_0) + (k_1 - k_0) ln n + 2 ln(variants tried) - 2 ln prior
#
# with n the number of independent samples and the prior that of a mistake of the rig (`surprise`).
#
# An amplitude that cannot be negative and is best at zero gains nothing: the test is one-sided by construction.
#
# Of an effect of the rig that is late, only what it explains outside of one event counts. A lateness is in all that a
# trace shows; but what follows a single edge, whose instant nobody logged, can often be told better a little later,
# and no other trace can speak against a trace that is late.


@dataclass(frozen=True)
class TrialVerdict:
    """The numbers by which a model with one effect more is judged beside the model before.

    Args:
        effect: the one tried.
        score: of the model with it.
        samples: fitted samples.
        fit_rms_ratio, holdout_rms_ratio: free-run RMS over that without it; the latter None without a holdout.
        holdout_chi2_change: change of chi2 of the held-out traces, or of traces left out in turn; None without either.
        bic_change: below 0 where it is worth its parameters.
        gain: by how much it lowers chi2 of the fitted traces.
        slack: allowed relative rise of the held-out free-run RMS.
        prior: -2 ln prior, a part of `bic_change`.
    """

    effect: Effect
    score: Score
    samples: float
    fit_rms_ratio: float
    holdout_rms_ratio: float | None
    holdout_chi2_change: float | None
    bic_change: float
    gain: float
    slack: float
    prior: float = 0.0

    def is_strong(self, settings: DiagnosisSettings) -> bool:
        """Whether BIC falls by enough for the effect to be worth its parameters."""
        return self.bic_change < settings.strong_bic_change

    def helps_elsewhere(self) -> bool:
        """Whether held-out traces do not contradict it; they need not show it: not every trace reaches a stop."""
        spared = self.holdout_chi2_change is None or self.holdout_chi2_change < SPARED_GAIN * self.gain
        return spared and (self.holdout_rms_ratio is None or self.holdout_rms_ratio < 1.0 + self.slack)


@dataclass(frozen=True, eq=False)
class Trial:
    """A refitted model and the verdict on it."""

    model: CandidateModel = field(repr=False)
    verdict: TrialVerdict

    @property
    def own_values(self) -> dict[str, float]:
        """The tried effect's parameters at the optimum, SI by symbol."""
        values = self.model.values
        return {symbol: values[symbol] for symbol in resting(self.verdict.effect)}


class Cost(NamedTuple):
    """What an effect costs in BIC: parameters that it frees, and variants of it among which was chosen."""

    parameters: int
    variants: int

    @classmethod
    def of_effect(cls, effect: Effect, composition: Composition) -> Cost:
        """An effect of the rig is one of as many as there are places where a rig may be wrong; whole tests and traces
        are asked first, so that only a channel of one trace is one of all such channels too."""
        among = composition.of_the_rig if is_of_the_rig(effect) else ()
        places = sum(is_of_one_channel(effect) or not is_of_one_channel(other) for other in among)
        return cls(len(resting(effect)), len(variants(effect)) * max(places, 1))


def bic_change(before: Score, after: Score, cost: Cost) -> float:
    """n ln(chi2_1 / chi2_0) + (k_1 - k_0) ln n + 2 ln(variants), n the smaller of both counts, at least 2."""
    n = max(2.0, min(before.count, after.count))
    likelihood = n * np.log(after.chi2 / before.chi2)
    return float(likelihood + cost.parameters * np.log(n) + 2.0 * np.log(max(cost.variants, 1)))


def compare(
    effect: Effect, before: Score, after: Score, cost: Cost, samples: float = np.inf, slack: float = 0.0
) -> TrialVerdict:
    """The verdict on a model with one effect more, from the scores without and with it."""
    held_out = None
    if after.held_out is not None and before.held_out is not None:
        held_out = after.held_out - before.held_out
    ratio = None
    if after.holdout_rms is not None and before.holdout_rms is not None:
        ratio = after.holdout_rms / before.holdout_rms
    change = bic_change(before, after, cost)
    fit_ratio = after.fit_rms / before.fit_rms
    return TrialVerdict(effect, after, samples, fit_ratio, ratio, held_out, change, before.chi2 - after.chi2, slack)


def judge_trial(effect: Effect, before: Score, s: CandidateModel, cost: Cost | None = None) -> Trial:
    """The trial of a refitted model that has one effect more than the one scored before."""
    slack, after = s.settings.rise_in_trial(s.far), score(s)
    counted = after
    if is_of_the_rig(effect) and effect.delays and s.at_work(effect):
        counted = replace(after, chi2=after.chi2 + gain_in_one_event(s, effect))
    verdict = compare(effect, before, counted, cost or Cost.of_effect(effect, s.composition), s.weighted.samples, slack)
    prior = surprise(effect, s.values, s.composition.stated) if s.at_work(effect) else 0.0
    return Trial(s, replace(verdict, score=after, bic_change=verdict.bic_change + prior, prior=prior))


def run_trial(s: CandidateModel, effect: Effect, values: Mapping[str, float], before: Score) -> Trial:
    """The trial of an effect that starts at `values` (SI by symbol), added to a model scored before."""
    return judge_trial(effect, before, s.trying((effect,), values).optimised())


def second_trial(s: CandidateModel, full: CandidateModel, before: Score, effect: Effect) -> Trial:
    """The trial at the coordinates where a full refit ended; its held-out RMS may rise as after any full refit.

    Args:
        s: the model of the first trial, whose whitening stays.
    """
    trial = judge_trial(effect, before, replace(s, x=full.x))
    return replace(trial, verdict=replace(trial.verdict, slack=s.settings.refit_rise))
