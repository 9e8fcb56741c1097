"""One model on trial: refitted with one effect more or less, and judged on what was fitted and on what was not.

Two models are compared under one and the same whitening and weights, those of the model as it stands, so that their
chi2 differ by what they explain and by nothing else:

    BIC change = n ln(chi2_1 / chi2_0) + (k_1 - k_0) ln n + 2 ln(variants tried),    n = number of independent samples

An amplitude that cannot be negative and is best at zero gains nothing: the test is one-sided by construction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..estimation.autocorrelation import inflation
from ..estimation.levenberg_marquardt import descend
from ..estimation.result import Termination
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import FreeParameters
from ..problem.prediction_error import PredictionError, columns, pooled, rows
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace
from .composition import Composition, Effect, carried

_TOLERANCE = 1e-3  # of a refit: relative change of chi2
_STEEP = 3.0  # times chi2 that a trial may begin with
_HALVINGS = 8  # of the amplitudes it begins with, until it does
_SPOILT = 1.5  # times chi2 per sample, each model's by its own whitening, by which one is worse than another
_SPARED = 0.01  # share of what is gained on the fitted traces that may be lost on those held out: they may not show it
_SLACK = 0.02  # relative rise of a held-out free-running error that counts as none: a slip may fall elsewhere
ASTRAY = 0.2  # the same of a model refitted in full
_DIVERGED = 2.0  # the same far from the data: that run begins from the optimum of a guided one and is not tuned itself


@dataclass(frozen=True, eq=False)
class CandidateModel:
    """The model as it stands, at its optimum.

    Args:
        composition: of which it is a part.
        added: effects at work beyond those known from the start, in the order found.
        problem, weighted: the fitted traces and how their residual is whitened.
        holdout: traces that are not fitted, and their whitening; None where there are none.
        x: coordinates.
        end: how the last full fit of it ended.
    """

    composition: Composition
    added: tuple[Effect, ...]
    problem: EstimationProblem
    weighted: WeightedData
    holdout: tuple[EstimationProblem, WeightedData] | None
    x: np.ndarray
    end: Termination

    @property
    def far(self) -> bool:
        """Too far from the data to be whitened: samples are weighed by what is left in them."""
        return self.end.far

    def with_effects(self, added: tuple[Effect, ...], values: Mapping[str, float]) -> CandidateModel:
        """The same data and whitening with other effects at work; new parameters start at `values` (SI)."""
        return self.within(self.composition, added, values)

    def without(self, effect: Effect) -> CandidateModel:
        """The same data and whitening with one of the effects added taken away again."""
        return self.with_effects(tuple(e for e in self.added if e is not effect), {})

    def within(
        self, composition: Composition, added: tuple[Effect, ...], values: Mapping[str, float]
    ) -> CandidateModel:
        """The same as a part of another composition."""
        free_parameters = composition.free_parameters(added)
        x = carried(self.x, self.problem.layout, free_parameters, values)
        return replace(self, composition=composition, added=added, x=x)._as(free_parameters)

    def lean(self) -> CandidateModel:
        """The same in a model of the effects at work alone: many times faster, but to be compiled for itself."""
        return self._as(self.composition.lean(self.added))

    def composed(self) -> CandidateModel:
        """The same as a part of the model of all effects."""
        return self._as(self.composition.free_parameters(self.added))

    def _as(self, free_parameters: FreeParameters) -> CandidateModel:
        problem, weighted = _told(self.problem, self.weighted, free_parameters)
        holdout = None if self.holdout is None else _told(*self.holdout, free_parameters)
        return replace(self, problem=problem, weighted=weighted, holdout=holdout)

    def trying(self, effect: Effect, values: Mapping[str, float]) -> CandidateModel:
        """With one effect more, at `values` (SI) or nearer to its off values: a promise is linear, the model is not."""
        most, at = _STEEP * self.chi2, dict(values)
        trial = self.with_effects((*self.added, effect), at)
        for _ in range(_HALVINGS):
            if trial.chi2 < most:
                break
            at |= {s: 0.5 * (at[s] + v) for s, v in (effect.off or {}).items()}
            trial = self.with_effects((*self.added, effect), at)
        return trial

    @property
    def chi2(self) -> float:
        """Of the fitted residual."""
        return self.problem.chi2(self.x, self.weighted)

    @property
    def left(self) -> float:
        """Chi2 per fitted sample: 1 where nothing but noise is left."""
        return self.chi2 / self.weighted.samples

    def spoilt(self, before: CandidateModel) -> bool:
        """A refit in full ended further from the data than the model it began with."""
        return not before.far and (self.far or not self.left < _SPOILT * before.left)

    def holds(self, before: CandidateModel, was: Score) -> bool:
        """Refitted in full it is neither further from the data than the model it began with nor astray from others."""
        return not self.spoilt(before) and not score(self).strays(was, self.far)

    def optimised(self) -> CandidateModel:
        """At the nearest optimum of the same residual."""
        return replace(self, x=descend(self.problem, self.x, self.weighted, _TOLERANCE)[0])

    @property
    def held_out(self) -> tuple[Trace, ...]:
        """Traces that are not fitted."""
        return () if self.holdout is None else self.holdout[0].batch.traces

    def at_work(self, effect: Effect) -> bool:
        return effect in self.added


def _told(
    problem: EstimationProblem, weighted: WeightedData, free_parameters: FreeParameters
) -> tuple[EstimationProblem, WeightedData]:
    new = problem.with_parameters(free_parameters)
    return new, new.weighted(weighted.whitening)


@dataclass(frozen=True, eq=False)
class Score:
    """How well a model does, fitted and held out.

    Args:
        chi2: of the fitted samples.
        count: of independent samples among them.
        held_out: chi2 of the held-out samples; None where there are none.
        fit_rows, holdout_rows: free-running errors by trace and channel.
    """

    chi2: float
    count: float
    held_out: float | None
    fit_rows: tuple[PredictionError, ...] = field(repr=False)
    holdout_rows: tuple[PredictionError, ...] = field(repr=False)

    @property
    def fit_rms(self) -> float:
        """Free-running error of the fitted traces, in sigma."""
        return pooled(self.fit_rows)

    @property
    def holdout_rms(self) -> float | None:
        """Free-running error of the held-out traces, in sigma."""
        return pooled(self.holdout_rows) if self.holdout_rows else None

    def strays(self, before: Score, far: bool) -> bool:
        """Refitted in full it predicts what was held out clearly worse; far from the data that run is not tuned yet."""
        if self.holdout_rms is None or before.holdout_rms is None:
            return False
        return clearly_worse(self.holdout_rms, before.holdout_rms, _DIVERGED if far else ASTRAY)


def clearly_worse(rms: float, before: float, rise: float = ASTRAY) -> bool:
    """A free-running error rose by more than a slip that falls elsewhere explains, or cannot be computed any more."""
    return not rms < (1.0 + rise) * before


def score(s: CandidateModel) -> Score:
    """Judge a model where it stands."""
    r = s.problem.residual(s.x, s.weighted)
    held_out, holdout_rows = None, ()
    if s.holdout is not None:
        problem, weighted = s.holdout
        held_out = float(chi2_of(problem, s.x[None], weighted)[0])
        holdout_rows = rows(problem.batch.traces, problem.free_run(s.x))
    fit_rows = rows(s.problem.batch.traces, s.problem.free_run(s.x))
    return Score(float(np.sum(r**2)), independent(s.problem, r), held_out, fit_rows, holdout_rows)


def independent(problem: EstimationProblem, r: np.ndarray) -> float:
    """How many independent samples a residual, shape (T, L, M), is worth."""
    count = 0.0
    for trace, part in zip(problem.batch.traces, columns(problem.batch, r), strict=True):
        for m in range(len(trace.channels)):
            own = part[np.isfinite(trace.data[:, m]), m]
            spread = float(np.sqrt(np.mean(own**2))) if own.size else 1.0
            count += own.size / inflation(own / max(spread, 1.0))
    return count


@dataclass(frozen=True, eq=False)
class TrialVerdict:
    """A candidate beside the model as it stands.

    Args:
        effect: which.
        standing: refitted with it.
        score: of that.
        fit_rms_ratio, holdout_rms_ratio: free-running errors over those without it; the latter None without a holdout.
        holdout_chi2_change: of the held-out residual, or of traces left out in turn.
        bic_change: below 0 where it is worth its parameters.
        gain: by how much it lowers chi2 of the fitted residual.
        slack: relative rise of the held-out free-running error that counts as none.
    """

    effect: Effect
    standing: CandidateModel
    score: Score
    fit_rms_ratio: float
    holdout_rms_ratio: float | None
    holdout_chi2_change: float | None
    bic_change: float
    gain: float
    slack: float

    def helps_elsewhere(self) -> bool:
        """Held-out traces do not contradict it; a rebound says nothing of traces without an impact."""
        spared = self.holdout_chi2_change is None or self.holdout_chi2_change < _SPARED * self.gain
        return spared and (self.holdout_rms_ratio is None or self.holdout_rms_ratio < 1.0 + self.slack)


def slack_of(s: CandidateModel) -> float:
    """Relative rise of the held-out free-running error that counts as none for a trial."""
    return _DIVERGED if s.far else _SLACK


def bic_change(before: Score, after: Score, parameters: int, tried: int) -> float:
    """See the module's head."""
    n = max(2.0, min(before.count, after.count))
    likelihood = n * np.log(after.chi2 / before.chi2)
    return float(likelihood + parameters * np.log(n) + 2.0 * np.log(max(tried, 1)))


def compare(effect: Effect, before: Score, s: CandidateModel, parameters: int, tried: int) -> TrialVerdict:
    """The verdict on a refitted model."""
    after = score(s)
    held_out = None
    if after.held_out is not None and before.held_out is not None:
        held_out = after.held_out - before.held_out
    ratio = None
    if after.holdout_rms is not None and before.holdout_rms is not None:
        ratio = after.holdout_rms / before.holdout_rms
    change = bic_change(before, after, parameters, tried)
    fit_ratio = after.fit_rms / before.fit_rms
    gain = before.chi2 - after.chi2
    return TrialVerdict(effect, s, after, fit_ratio, ratio, held_out, change, gain, slack_of(s))
