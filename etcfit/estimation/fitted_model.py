"""A fitted model as others go on from it: what was free, where it ended, how well it is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np

from ..model.throttle import Throttle
from ..problem.free_parameters import Unknowns
from ..rig.base import RigConfig


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its optimum.

    Args:
        config: of the rig.
        unknowns: what was free in it.
        x: coordinates at the optimum, shape (P,).
        covariance: of the coordinates, shape (P, P).
    """

    config: RigConfig
    unknowns: Unknowns
    x: np.ndarray
    covariance: np.ndarray

    @cached_property
    def values(self) -> dict[str, float]:
        """SI by symbol."""
        return {s: float(v) for s, v in self.unknowns.layout.values(self.x, self.unknowns.held).items()}

    @property
    def throttle(self) -> Throttle:
        """The model."""
        return Throttle.build(self.unknowns.layout.types, self.values)

    def doubt(self, symbol: str) -> float:
        """Standard deviation of a parameter's coordinate over its reach, about its relative error; 0 if not free."""
        layout = self.unknowns.layout
        if symbol not in layout.free:
            return 0.0
        k = layout.free.index(symbol)
        variance = float(self.covariance[k, k])
        return math.sqrt(variance) / float(layout.reach(self.x)[k]) if variance >= 0.0 else math.inf

    def throttles(self, x: np.ndarray) -> Throttle:
        """Many at once, of coordinates of shape (D, P): parameters of shape (D,)."""
        layout = self.unknowns.layout
        pick = layout.pick(self.unknowns.held)
        values = jax.jit(jax.vmap(lambda each: layout.form.values(each, pick)))(layout.padded(x))
        return Throttle.build(layout.types, values)

    def laplace(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Coordinates drawn from the normal distribution of the fit, shape (count, P).

        A direction that the data leave open is drawn no wider than a hundred percent.
        """
        reach = self.unknowns.layout.reach(self.x)
        spread = np.nan_to_num(self.covariance / np.outer(reach, reach), posinf=1.0, neginf=0.0)
        variance, directions = np.linalg.eigh(0.5 * (spread + spread.T))
        sd = np.sqrt(np.clip(variance, 0.0, 1.0))
        return self.x + reach * ((rng.standard_normal((count, self.x.size)) * sd) @ directions.T)

    def coordinates(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Coordinates of many values in SI by symbol, shape (D,) each; shape (D, P)."""
        rows = zip(*(np.asarray(values[s]).tolist() for s in self.unknowns.layout.free), strict=True)
        return np.array([self.unknowns.layout.coordinates(dict(zip(self.unknowns.layout.free, row, strict=True)))
                         for row in rows])  # fmt: skip

    def gradient(self, function: Any) -> np.ndarray:
        """Derivative in coordinates of a function of the values (SI, by symbol), shape (..., P)."""
        layout = self.unknowns.layout
        pick = layout.pick(self.unknowns.held)
        slope = jax.jit(jax.jacfwd(lambda x: function(layout.form.values(x, pick))))(layout.padded(self.x))
        return np.asarray(slope)[..., : self.x.size]
