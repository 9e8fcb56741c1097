"""An ensemble of walkers: its whole history, its random state, and how it goes on. Nothing else runs emcee's sampler.

Walkers live in standard coordinates u, x = centre + root u, in which the posterior is about standard normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import emcee
import numpy as np

from .approximation import LogProbability
from .moves import moves
from .settings import SamplingSettings


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Walkers after N steps.

    Args:
        points: standard coordinates, the start first, shape (N + 1, W, P).
        log_probability: shape (N + 1, W).
        accepted: moves accepted by each walker, shape (W,).
        random: state of the random numbers, as numpy's RandomState has it.
    """

    points: np.ndarray
    log_probability: np.ndarray
    accepted: np.ndarray
    random: Any

    @classmethod
    def begin(
        cls, target: LogProbability, size: int, seed: int, settings: SamplingSettings = SamplingSettings()
    ) -> Ensemble:
        """Walkers drawn from a standard normal.

        Far from the mode the density may lie far below the normal one that describes it near the mode. A walker drawn
        there is moved halfway to the mode, again and again until it no longer is.

        Args:
            target: log-probability of standard coordinates, shape (K, P) -> (K,).
            size: P.
            seed: of the random numbers.
            settings: how many walkers, and which are no start.
        """
        random = np.random.RandomState(seed)
        points = random.standard_normal((max(settings.least_walkers, settings.walkers_per_coordinate * size), size))
        here = target(points)
        least = float(target(np.zeros((len(points), size)))[0]) - 0.5 * (size + settings.typical * np.sqrt(2.0 * size))
        for _ in range(settings.halvings):
            astray = here < least
            if not astray.any():
                break
            points = np.where(astray[:, None], 0.5 * points, points)
            here = target(points)
        return cls(points[None], here[None], np.zeros(len(points)), random.get_state())

    @property
    def steps(self) -> int:
        """N."""
        return len(self.points) - 1

    @property
    def acceptance(self) -> float:
        """Share of moves accepted."""
        return float(np.mean(self.accepted)) / max(1, self.steps)

    def advanced(self, target: LogProbability, steps: int) -> Ensemble:
        """The ensemble after some more steps."""
        walkers, size = self.points.shape[1:]
        sampler = emcee.EnsembleSampler(walkers, size, target, moves=moves(), vectorize=True)
        last = emcee.State(self.points[-1], log_prob=self.log_probability[-1], random_state=self.random)
        sampler.run_mcmc(last, steps, skip_initial_state_check=True)
        return replace(
            self,
            points=np.concatenate((self.points, np.asarray(sampler.get_chain()))),
            log_probability=np.concatenate((self.log_probability, np.asarray(sampler.get_log_prob()))),
            accepted=self.accepted + sampler.backend.accepted,
            random=sampler.random_state,
        )
