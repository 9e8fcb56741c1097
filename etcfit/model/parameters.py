"""Parameters: the meaning of each symbol, its domain, and the unconstrained coordinate in which it is fitted."""

from __future__ import annotations

import abc
import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .. import backend as backend  # float64, before the first array

if TYPE_CHECKING:
    AnyArray = Scalar = Any  # arithmetic mixes all of the types below, which a static union refuses
else:
    AnyArray = Array | np.ndarray
    Scalar = float | Float[AnyArray, "..."]
"""An array: of NumPy until a compiled function takes it, of JAX inside. A scalar: one number, or an array of any shape
taken entry by entry, since what steps one throttle also steps a batch of them."""


class AbstractDomain(abc.ABC):
    """Domain of a parameter: value = scale curve(x), with x the unbounded coordinate that a fit moves.

    Attributes:
        scale: a typical magnitude of the value, SI.
    """

    scale: float

    @staticmethod
    @abc.abstractmethod
    def curve(x: Scalar, by: Any = jnp) -> Scalar:
        """value / scale at coordinate x, both dimensionless; elementwise for arrays, by JAX or by NumPy."""

    @staticmethod
    @abc.abstractmethod
    def slope(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Derivative of `curve` at coordinate x, by NumPy."""

    def value(self, x: Scalar) -> Scalar:
        """Value in SI at coordinate x (dimensionless)."""
        return self.scale * self.curve(x)

    @staticmethod
    @abc.abstractmethod
    def log_flat(x: Scalar, by: Any = jnp) -> Scalar:
        """log |dq/dx| of the quantity q whose prior is flat: the log density of this prior in x, up to a constant."""

    @abc.abstractmethod
    def coordinate(self, value: float) -> float:
        """The coordinate of a value in SI; a value on or beyond the bound is moved just inside."""

    @abc.abstractmethod
    def inside(self, value: float) -> float:
        """The nearest value, SI, that still changes with the coordinate: a fit that starts on a bound would stay
        there."""

    @abc.abstractmethod
    def at_bound(self, value: float) -> bool:
        """Whether the value is so close to the bound that the bound, not the data, determines it."""


_REACH = 12.0  # a positive parameter stays within exp(-12) and exp(12) of its scale


@dataclass(frozen=True)
class Positive(AbstractDomain):
    """value = scale exp(c tanh(x / c)) > 0, c = 12: a logarithm that saturates, so that it stays finite if the data
    have no information."""

    scale: float

    @staticmethod
    def curve(x: Scalar, by: Any = jnp) -> Scalar:
        return by.exp(_REACH * by.tanh(x / _REACH))

    @staticmethod
    def slope(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return Positive.curve(x, np) * (1.0 - np.tanh(x / _REACH) ** 2)

    @staticmethod
    def log_flat(x: Scalar, by: Any = jnp) -> Scalar:
        """q = log value, since its order of magnitude is unknown: dq/dx = sech^2(x / c)."""
        y = by.abs(x / _REACH)
        return 2.0 * (math.log(2.0) - y - by.log1p(by.exp(-2.0 * y)))

    def coordinate(self, value: float) -> float:
        log = math.log(max(value, 1e-300) / self.scale) / _REACH
        return _REACH * math.atanh(min(max(log, -0.99), 0.99))

    def inside(self, value: float) -> float:
        return max(value, 1e-3 * self.scale)

    def at_bound(self, value: float) -> bool:
        return value < 1e-4 * self.scale


_SOFTNESS = 0.02  # width of the bend at zero, in units of `scale`


@dataclass(frozen=True)
class NonNegative(AbstractDomain):
    """value = scale (x + sqrt(x^2 + e^2))/2 with e = 0.02: about scale x above zero, and never below it.

    With a logarithm the coordinate of a friction of zero would go to minus infinity. Here it stays finite,
    and the interval of a small but measurable value stays symmetric.
    """

    scale: float

    @staticmethod
    def curve(x: Scalar, by: Any = jnp) -> Scalar:
        # both branches are equal; the second has no cancellation for x << 0
        root = by.sqrt(x * x + _SOFTNESS**2)
        return 0.5 * by.where(x >= 0.0, x + root, _SOFTNESS**2 / (root + by.abs(x)))

    @staticmethod
    def slope(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return NonNegative.curve(x, np) / np.sqrt(x * x + _SOFTNESS**2)

    @staticmethod
    def log_flat(x: Scalar, by: Any = jnp) -> Scalar:
        """q = value / scale, since it may be zero: dq/dx = q / sqrt(x^2 + e^2)."""
        return by.log(NonNegative.curve(x, by) / by.sqrt(x * x + _SOFTNESS**2))

    def coordinate(self, value: float) -> float:
        y = max(value / self.scale, 0.25 * _SOFTNESS)
        return y - _SOFTNESS**2 / (4.0 * y)

    def inside(self, value: float) -> float:
        return max(value, 0.25 * self.scale)

    def at_bound(self, value: float) -> bool:
        # compare with the result of `coordinate` for a bound, rounding included
        return value < 0.26 * _SOFTNESS * self.scale


@dataclass(frozen=True)
class Real(AbstractDomain):
    """value = scale x: either sign."""

    scale: float

    @staticmethod
    def curve(x: Scalar, by: Any = jnp) -> Scalar:
        return x

    @staticmethod
    def slope(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return np.ones_like(x)

    @staticmethod
    def log_flat(x: Scalar, by: Any = jnp) -> Scalar:
        """q = value / scale = x."""
        return by.zeros_like(x)

    def coordinate(self, value: float) -> float:
        return value / self.scale

    def inside(self, value: float) -> float:
        return value

    def at_bound(self, value: float) -> bool:
        return False


DOMAINS: tuple[type[AbstractDomain], ...] = (Positive, NonNegative, Real)


def curves(kinds: Int[AnyArray, " P"], x: Float[AnyArray, "*K P"], by: Any = jnp) -> Float[AnyArray, "*K P"]:
    """value / scale of many coordinates at once.

    Args:
        kinds: domain of each, an index into `DOMAINS`, shape (P,). It is data: another choice of free parameters uses
            the same compiled program.
        x: coordinates, shape (..., P), dimensionless.
        by: JAX or NumPy.
    Returns:
        Shape (..., P), dimensionless.
    """
    out = x
    for k, domain in enumerate(DOMAINS):
        out = by.where(kinds == k, domain.curve(x, by), out)
    return out


def slopes(kinds: Int[np.ndarray, " P"], x: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
    """Derivatives of `curves`, shape (P,), by NumPy."""
    return np.choose(kinds, [domain.slope(x) for domain in DOMAINS])


def log_flats(kinds: Int[AnyArray, " P"], x: Float[AnyArray, "*K P"], by: Any = jnp) -> Float[AnyArray, "*K P"]:
    """log |dq/dx| of many coordinates at once, q the quantity with a flat prior in the domain of each; as `curves`."""
    out = by.zeros_like(x)
    for k, domain in enumerate(DOMAINS):
        out = by.where(kinds == k, domain.log_flat(x, by), out)
    return out


@dataclass(frozen=True)
class Parameter:
    """A physical quantity of the model.

    Args:
        symbol: the paper's symbol, in ASCII.
        unit: SI unit.
        domain: bounds and coordinate; its scale is a typical magnitude.
        nominal: value assumed without any information, SI.
        meaning: one line.
        source: paper and equation.
    """

    symbol: str
    unit: str
    domain: AbstractDomain
    nominal: float
    meaning: str
    source: str


def parameter(unit: str, domain: AbstractDomain, nominal: float, meaning: str, source: str) -> Any:
    """Declare a field of an effect to be a parameter.

    Args:
        unit, domain, nominal, meaning, source: see `Parameter`. The symbol is the field's name, unless the effect
            changes it.
    """
    return dataclasses.field(metadata={"parameter": (unit, domain, nominal, meaning, source)})


def declared(effect: Any) -> dict[str, Parameter]:
    """The parameters that an effect declares, by the names of its fields, in their order."""
    found = (f for f in dataclasses.fields(effect) if "parameter" in f.metadata)
    return {f.name: effect.named(Parameter(f.name, *f.metadata["parameter"])) for f in found}


def parameters_of(effect: Any) -> tuple[Parameter, ...]:
    """The parameters that an effect declares, in the order of its fields."""
    return tuple(declared(effect).values())
