"""The model at one point of the diagnosis: the effects at work, the values of their parameters, and the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.levenberg_marquardt import descend, linearise_at
from ..estimation.result import Termination
from ..estimation.rounds import deviance, evolve_population
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import FreeParameters
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace
from .composition import Composition, Effect, carried, resting
from .settings import DiagnosisSettings

TRIAL_TOLERANCE = 1e-3  # relative change of chi2 that ends the refit of a trial
STEEPEST_START = 3.0  # chi2 with which a trial may begin, over that of the model without the effect
SEARCH_SPREAD = 0.15  # standard deviation of a population in a coordinate of a rough effect, over the coordinate
START_HALVINGS = 8  # times that the amplitudes are halved at most until a trial begins below that


@dataclass(frozen=True, eq=False)
class CandidateModel:
    """A choice of effects, the values of their parameters, and the data that they are fitted to."""

    composition: Composition  # the model of all effects, of which it is a part
    added: tuple[Effect, ...]  # effects at work beyond those known from the start, in the order found
    # problem, weighted: the fitted traces and how their residual is whitened
    problem: EstimationProblem
    weighted: WeightedData
    # traces that are not fitted, and their whitening; None where there are none
    holdout: tuple[EstimationProblem, WeightedData] | None
    x: np.ndarray  # coordinates of the free parameters, shape (P,)
    end: Termination  # how its last full refit ended
    settings: DiagnosisSettings  # what the diagnosis decides by

    @property
    def far(self) -> bool:
        """Whether the model is too far from the data to whiten: each sample is then weighed by its own residual."""
        return self.end.far

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual of the fitted traces."""
        return self.problem.chi2(self.x, self.weighted)

    @property
    def chi2_per_sample(self) -> float:
        """1 where nothing but noise is left."""
        return self.chi2 / self.weighted.samples

    @property
    def deviance(self) -> float:
        """-2 log L of the fitted traces by their own whitening, up to a constant; without meaning far from the data."""
        return deviance(self.problem, self.weighted, self.x)

    @property
    def held_out(self) -> tuple[Trace, ...]:
        """Traces that are not fitted."""
        return () if self.holdout is None else self.holdout[0].batch.traces

    @property
    def values(self) -> dict[str, float]:
        """All parameters, SI by symbol."""
        return self.problem.free_parameters.values(self.x)

    def at_work(self, effect: Effect) -> bool:
        """Whether the effect was added."""
        return effect in self.added

    def with_effects(self, added: tuple[Effect, ...], values: Mapping[str, float]) -> CandidateModel:
        """Other effects at work, data and whitening unchanged.

        Args:
            added: effects at work beyond those known from the start.
            values: SI by symbol, for the parameters that become free; shared ones keep their coordinates.
        Raises:
            KeyError: a parameter that becomes free has no value.
        """
        return self.within(self.composition, added, values)

    def at_end_of(self, added: tuple[Effect, ...], values: Mapping[str, float]) -> CandidateModel:
        """Other effects at work, at the values where another model's refit ended, SI by symbol; parameters that it has
        no value for keep their coordinates."""
        s = self.with_effects(added, values)
        return replace(s, x=s.problem.layout.coordinates({**s.values, **values}))

    def without(self, effect: Effect) -> CandidateModel:
        """The model with one of the added effects taken away, data and whitening unchanged."""
        return self.with_effects(tuple(e for e in self.added if e is not effect), {})

    def within(
        self, composition: Composition, added: tuple[Effect, ...], values: Mapping[str, float]
    ) -> CandidateModel:
        """As `with_effects`, as a part of another composition."""
        free_parameters = composition.on_trial(added)
        x = carried(self.x, self.problem.layout, free_parameters, values)
        return replace(self, composition=composition, added=added, x=x)._as(free_parameters)

    def lean(self) -> CandidateModel:
        """The same model, equal in every number, simulated without the effects that are off."""
        return self._as(self.composition.lean(self.added))

    def composed(self, asleep: tuple[Effect, ...]) -> CandidateModel:
        """The same model, equal in every number, simulated with some candidates at their off values, which screening
        needs."""
        return self._as(self.composition.with_asleep(asleep, self.added))

    def with_the_rig(self) -> CandidateModel:
        """The model with every candidate of the rig at work at its off value, to differentiate the residual along each
        of them."""
        off = {s: v for e in self.composition.of_the_rig if not self.at_work(e) for s, v in resting(e).items()}
        free_parameters = self.composition.with_the_rig(self.added)
        x = carried(self.x, self.problem.layout, free_parameters, off)
        return replace(self, x=x)._as(free_parameters)

    def _as(self, free_parameters: FreeParameters) -> CandidateModel:
        problem, weighted = _with_parameters(self.problem, self.weighted, free_parameters)
        holdout = None if self.holdout is None else _with_parameters(*self.holdout, free_parameters)
        return replace(self, problem=problem, weighted=weighted, holdout=holdout)

    def trying(self, effects: tuple[Effect, ...], values: Mapping[str, float]) -> CandidateModel:
        """The model with further effects, not yet refitted.

        The values come from a linear model, so they may lead far off: amplitudes are halved towards their off values
        until chi2 is no more than `STEEPEST_START` times that without the effects, or `START_HALVINGS` are spent.

        Args:
            values: of their parameters, SI by symbol.
        """
        most, at = STEEPEST_START * self.chi2, dict(values)
        trial = self.with_effects((*self.added, *effects), at)
        for _ in range(START_HALVINGS):
            if trial.chi2 < most:
                break
            at |= {s: 0.5 * (at[s] + v) for effect in effects for s, v in (effect.off or {}).items()}
            trial = self.with_effects((*self.added, *effects), at)
        return trial

    def optimised(self) -> CandidateModel:
        """The model at its nearest optimum under its whitening."""
        x, _ = descend(self.problem, self.x, self.weighted, TRIAL_TOLERANCE)
        return replace(self, x=x)

    def searched(self, effect: Effect) -> CandidateModel:
        """At the deepest optimum that a population finds about this one, spread widely over the effect's parameters.

        The population begins with standard deviations of `SEARCH_SPREAD` of the effect's own coordinates, and of 3
        standard errors, at most 0.1, of the others.
        """
        layout, own = self.problem.layout, resting(effect)
        mine = np.array([symbol in own for symbol in layout.free])
        stderr = np.sqrt(np.diag(linearise_at(self.problem, self.x, self.weighted).covariance))
        spread = np.where(mine, SEARCH_SPREAD * np.abs(self.x), np.minimum(3.0 * stderr, 0.1))
        x = evolve_population(lambda points: chi2_of(self.problem, points, self.weighted), self.x, spread)
        return replace(self, x=x).optimised()


def _with_parameters(
    problem: EstimationProblem, weighted: WeightedData, free_parameters: FreeParameters
) -> tuple[EstimationProblem, WeightedData]:
    new = problem.with_parameters(free_parameters)
    return new, new.weighted(weighted.whitening)
