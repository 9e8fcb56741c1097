"""A fitted model for design, reduction and sampling: what was free, where the fit ended, how well that is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax
import numpy as np

from ..model.throttle import Throttle
from ..problem.free_parameters import Form, FreeParameters, Pick
from ..rig.base import RigConfig
from .fit_state import SOUND, FitState
from .settings import IdentifiabilitySettings


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its optimum.

    Args:
        config: of the rig.
        free_parameters: what was free in it.
        x: coordinates at the optimum, shape (P,).
        covariance: of the coordinates, as wide as their intervals are stated, shape (P, P).
        identifiability: by what the fit called a parameter not known.
        state: in which its fit ended.
        position_noise: standard deviation of one reading of the rig's position, rad, the median of its traces.
    """

    config: RigConfig
    free_parameters: FreeParameters
    x: np.ndarray
    covariance: np.ndarray
    identifiability: IdentifiabilitySettings = IdentifiabilitySettings()
    state: FitState = SOUND
    position_noise: float = 0.0

    @cached_property
    def values(self) -> dict[str, float]:
        """Of every parameter, SI, by symbol."""
        return self.free_parameters.values(self.x)

    @property
    def throttle(self) -> Throttle:
        """The model."""
        return Throttle.build(self.free_parameters.layout.types, self.values)

    def doubt(self, symbol: str) -> float:
        """Standard deviation of a parameter's coordinate over its reach, about its relative error; 0 if not free."""
        layout = self.free_parameters.layout
        if symbol not in layout.free:
            return 0.0
        k = layout.free.index(symbol)
        variance = float(self.covariance[k, k])
        return math.sqrt(variance) / float(layout.reach(self.x)[k]) if variance >= 0.0 else math.inf

    def throttles(self, x: np.ndarray) -> Throttle:
        """Models at many coordinates, shape (D, P): one whose parameters have shape (D,)."""
        return Throttle.build(self.free_parameters.layout.types, self.values_at(x))

    def values_at(self, x: np.ndarray) -> dict[str, Any]:
        """Of every parameter, SI, by symbol, at many coordinates, shape (D, P): shape (D,) each."""
        layout = self.free_parameters.layout
        return _values_at(layout.form, layout.padded(x), layout.pick(self.free_parameters.held))

    def laplace(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Coordinates drawn from the normal distribution of the fit, shape (count, P).

        A direction that the data leave open is drawn no wider than a hundred percent.
        """
        reach = self.free_parameters.layout.reach(self.x)
        spread = np.nan_to_num(self.covariance / np.outer(reach, reach), posinf=1.0, neginf=0.0)
        variance, directions = np.linalg.eigh(0.5 * (spread + spread.T))
        sd = np.sqrt(np.clip(variance, 0.0, 1.0))
        return self.x + reach * ((rng.standard_normal((count, self.x.size)) * sd) @ directions.T)

    def coordinates(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Coordinates of many values in SI by symbol, shape (D,) each; shape (D, P)."""
        layout = self.free_parameters.layout
        rows = zip(*(np.asarray(values[s]).tolist() for s in layout.free), strict=True)
        return np.array([layout.coordinates(dict(zip(layout.free, row, strict=True))) for row in rows])

    def gradient(self, function: Any) -> np.ndarray:
        """Derivative of `function(values)`, values in SI by symbol, by the coordinates at x, shape (..., P)."""
        layout = self.free_parameters.layout
        pick = layout.pick(self.free_parameters.held)
        slope = jax.jit(jax.jacfwd(lambda x: function(layout.form.values(x, pick))))(layout.padded(self.x))
        return np.asarray(slope)[..., : self.x.size]


@partial(jax.jit, static_argnums=0)
def _values_at(form: Form, x: Any, pick: Pick) -> dict[str, Any]:
    """Values at many coordinates; compiled once for a model and a number of them, not at each call."""
    return jax.vmap(form.values, in_axes=(0, None))(x, pick)
