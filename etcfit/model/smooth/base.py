"""Effects of unknown causes, which vary smoothly over one axis along a curve that the data determine; axes and
knots."""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from ..effects import AbstractEffect, Contribution, Inputs, State, fraction
from ..parameters import Real, Scalar, parameter

K = 10  # number of knots of every axis


@dataclass(frozen=True)
class Axis:
    """K knots of a curve, equally spaced in the value a, or in asinh(a / bend): then closer together about zero."""

    name: str  # name of the quantity along it
    unit: str  # unit of its values, SI
    value: Callable[[State, Inputs], Scalar]  # a as a function of state and inputs
    # low, high: first and last knot, in that unit
    low: float
    high: float
    # value at which the spacing turns from even to logarithmic, in that unit; None for even spacing
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


# part of the contribution -> (its unit, a typical size)
ENTERS: Mapping[str, tuple[str, float]] = {
    "torque": ("N*m", 0.05),
    "friction": ("N*m", 0.05),
    "voltage": ("V", 0.2),
    "position": ("rad", 0.02),
}


class AbstractSmooth(AbstractEffect):
    """contribution = sum_k c_k hat_k(a): hat_k is 1 at knot k of the axis a, 0 at every other, linear in between.

    Beyond the outer knots it is constant. "Linear" is in the coordinate of the axis (see `Axis`).

    Source: de Boor 1978, A practical guide to splines, B-splines of order 2. Differs from source: no.

    Attributes:
        enters: the part of `Contribution` that it adds to.
        along: its axis; `axis` and `axis_unit` are the name and unit, `knots` the values at its knots.
        unit: unit of the contribution and of the amplitudes c_k, its fields.
    """

    enters: ClassVar[str]
    unit: ClassVar[str]
    along: ClassVar[Axis]
    axis: ClassVar[str]
    axis_unit: ClassVar[str]
    knots: ClassVar[tuple[float, ...]]
    symbols: ClassVar[tuple[str, ...]]

    def shape(self, value: Scalar) -> Scalar:
        """The contribution at a value of the axis, in `unit`; element by element for an array of any shape."""
        place = self.along.place(value)
        c = [getattr(self, symbol) for symbol in self.symbols]
        # a sum of ramps instead of hats: its slope at a knot is the mean of the slopes on both sides
        rises = ((after - before) * jnp.clip(place - k, 0.0, 1.0) for k, (before, after) in enumerate(pairwise(c)))
        return sum(rises, start=c[0])

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        felt = 1.0 if self.enters == "voltage" else u.plate  # a motor alone has a circuit, but no plate
        return Contribution(**{self.enters: felt * self.shape(self.along.value(x, u))})


def smooth(prefix: str, enters: str, along: Axis) -> type[AbstractSmooth]:
    """An abstract smooth effect with K amplitudes as its fields: prefix0, prefix1 and so on, each off at 0."""
    unit, scale = ENTERS[enters]
    symbols = tuple(f"{prefix}{k}" for k in range(K))

    def amplitude(knot: float) -> Any:
        meaning = f"unknown {enters} at {along.name} {knot:.3g} {along.unit}".removesuffix(" 1")
        return parameter(unit, Real(scale), 0.0, meaning, "de Boor 1978")

    body: dict[str, Any] = {
        "__module__": __name__,
        "__annotations__": dict.fromkeys(symbols, Scalar),
        "enters": enters,
        "unit": unit,
        "along": along,
        "axis": along.name,
        "axis_unit": along.unit,
        "knots": along.knots,
        "symbols": symbols,
        "off": dict.fromkeys(symbols, 0.0),
        "loaded": along.name == "load",
    }
    body |= {symbol: amplitude(knot) for symbol, knot in zip(symbols, along.knots, strict=True)}
    return types.new_class(f"AbstractSmooth_{prefix}", (AbstractSmooth,), {}, lambda namespace: namespace.update(body))
