"""Over what a smooth effect varies, and where its knots lie."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ..effects import Inputs, State, fraction
from ..parameters import Scalar

K = 10  # knots of every axis


@dataclass(frozen=True)
class Axis:
    """K knots of a curve, equally spaced in the value a, or in asinh(a / bend): then closer together about zero.

    Args:
        name: of the quantity along it.
        unit: of its values, SI.
        value: a as a function of state and inputs.
        low, high: first and last knot, in that unit.
        bend: where the spacing turns from even to logarithmic, in that unit; None for even spacing.
    """

    name: str
    unit: str
    value: Callable[[State, Inputs], Scalar]
    low: float
    high: float
    bend: float | None = None

    @property
    def knots(self) -> tuple[float, ...]:
        """Values at the knots, ascending, shape (K,)."""
        if self.bend is None:
            return tuple(np.linspace(self.low, self.high, K).tolist())
        first, last = math.asinh(self.low / self.bend), math.asinh(self.high / self.bend)
        return tuple((self.bend * np.sinh(np.linspace(first, last, K))).tolist())

    def place(self, value: Scalar) -> Scalar:
        """Place of a value among the knots, dimensionless: 0 at the first, K - 1 at the last."""
        if self.bend is None:
            return (value - self.low) * ((K - 1) / (self.high - self.low))
        first, last = math.asinh(self.low / self.bend), math.asinh(self.high / self.bend)
        return (jnp.arcsinh(value / self.bend) - first) * ((K - 1) / (last - first))


def travelled(x: State, u: Inputs) -> Scalar:
    """The angle as a share of the travel, 0 at the lower stop and 1 at the upper."""
    return fraction(x.theta, u.lower, u.upper)


ANGLE = Axis("angle", "1", travelled, 0.0, 1.0)
DIRECTED_SPEED = Axis("speed", "rad/s", lambda x, u: x.omega, -30.0, 30.0, 0.3)
SPEED = Axis("speed", "rad/s", lambda x, u: jnp.abs(x.omega), 0.0, 30.0, 0.3)
LOAD = Axis("load", "N*m", lambda x, u: jnp.abs(u.gear_load), 0.0, 3.0, 0.1)
CURRENT = Axis("current", "A", lambda x, u: x.i, -10.0, 10.0, 0.2)
TIME = Axis("time", "s", lambda x, u: u.time, 0.0, 60.0, 0.5)
