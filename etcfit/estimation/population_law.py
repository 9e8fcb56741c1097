"""How the units of a design scatter, as far as a fleet tells: the law of a unit that is not made yet.

    theta_j = mean_j exp(s_j t_j - s_j^2 / 2)   of what is positive,     theta_j = mean_j + r_j t_j   of the rest
    r_j^2 = sd_j^2 + stderr_j^2,   s_j^2 = log(1 + r_j^2 / mean_j^2),    t ~ t_(U-1)(0, R)

Wider than the units, for mean, sd and R are known from U units only.

Source: Gelman et al. 2013, Bayesian Data Analysis, section 3.6. Differs from source: U - 1 degrees of freedom whatever
the number of parameters, as for each of them alone; errors of the means are taken to go together as the units do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class PopulationLaw:
    """Of P parameters or sums of them, SI.

    Args:
        symbols: P of them.
        mean: between units, shape (P,).
        sd: between units, their own uncertainty taken off, shape (P,).
        stderr: of the mean, shape (P,).
        correlation: R, between units, shape (P, P); 0 beside what has no spread.
        positive: what cannot be negative, shape (P,).
        units: U, from which all this is known; 2 or more.
    """

    symbols: tuple[str, ...]
    mean: Float[np.ndarray, " P"]
    sd: Float[np.ndarray, " P"]
    stderr: Float[np.ndarray, " P"]
    correlation: Float[np.ndarray, "P P"]
    positive: Bool[np.ndarray, " P"]
    units: int

    @classmethod
    def of_units(cls, values: Mapping[str, np.ndarray], positive: Mapping[str, bool]) -> PopulationLaw:
        """That of units whose values are known exactly.

        Args:
            values: SI by symbol, shape (U,).
            positive: by symbol.
        """
        every = np.array(list(values.values()), dtype=float)
        count = every.shape[1]
        sd = every.std(axis=1, ddof=1)
        alike = every - every.mean(axis=1, keepdims=True)
        size = np.where(sd > 0.0, sd, 1.0)
        correlation = alike @ alike.T / (count - 1) / np.outer(size, size)
        np.fill_diagonal(correlation, 1.0)
        return cls(tuple(values), every.mean(axis=1), sd, sd / np.sqrt(count), correlation,
                   np.array([positive[symbol] for symbol in values]), count)  # fmt: skip

    def drawn(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """So many units, SI by symbol, shape (count,)."""
        value, vector = np.linalg.eigh(self.correlation)
        normal = rng.standard_normal((count, len(self.symbols))) @ (vector * np.sqrt(np.maximum(value, 0.0))).T
        degrees = self.units - 1
        t = normal * np.sqrt(degrees / rng.chisquare(degrees, count))[:, None]
        wide = np.hypot(self.sd, self.stderr)
        log = self.positive & (self.mean > 0.0)
        s = np.sqrt(np.log1p((wide / np.where(log, self.mean, np.inf)) ** 2))
        drawn = np.where(log, self.mean * np.exp(s * t - 0.5 * s**2), self.mean + wide * t)
        return dict(zip(self.symbols, drawn.T, strict=True))
