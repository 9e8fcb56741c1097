"""A posterior that is known: a linear model with normal noise, flat prior. No throttle, no JAX."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etcfit.posterior.chain import Chain
from etcfit.posterior.settings import SamplingSettings

SEEDS = SamplingSettings(seeds=(1, 2))


@dataclass(frozen=True, eq=False)
class Linear:
    """y = A x + noise of sd 1: the posterior is normal with covariance (A^T A)^-1 about the least squares solution."""

    design: np.ndarray  # A, shape (n, P)
    data: np.ndarray  # y, shape (n,)

    @classmethod
    def make(cls, size: int = 3, samples: int = 40, seed: int = 5) -> Linear:
        """Columns of very different size, two of them nearly alike."""
        rng = np.random.default_rng(seed)
        design = rng.standard_normal((samples, size)) * 10.0 ** np.arange(size)
        design[:, 1] += 9.0 * design[:, 0]
        return cls(design, design @ np.ones(size) + rng.standard_normal(samples))

    @property
    def symbols(self) -> tuple[str, ...]:
        return tuple(f"x{k}" for k in range(self.design.shape[1]))

    @property
    def covariance(self) -> np.ndarray:
        return np.linalg.inv(self.design.T @ self.design)

    @property
    def mean(self) -> np.ndarray:
        return self.covariance @ self.design.T @ self.data

    def log_probability(self, points: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum((self.data - points @ self.design.T) ** 2, axis=1)

    def begin(self, guess: float = 1.0) -> Chain:
        """Two ensembles, from a covariance that is wrong by the factor `guess` in every standard deviation."""
        return Chain.begin(self.log_probability, self.symbols, self.mean, guess**2 * self.covariance, SEEDS)
