"""Stribeck friction: what sticks holds faster than what slides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_AT_REST = 1e-12  # share of the Stribeck speed below which a power would have no finite slope
_VANISHED = 6.0  # log of the largest power that is told from infinity: exp(-exp(6)) = 1e-175


def _power(ratio: Scalar, exponent: Scalar) -> Scalar:
    """ratio^exponent for ratio >= 0, with finite derivatives at a plate at rest and at any exponent."""
    log = exponent * jnp.log(jnp.maximum(ratio, _AT_REST))
    return jnp.exp(jnp.minimum(log, _VANISHED))


class StribeckFriction(AbstractEffect):
    """friction = T_s exp(-(|omega| / omega_s)^delta_s), on top of the Coulomb friction T_f: T_f + T_s at rest.

    Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, Eur. J. Control 4(3), section 2.
    Differs from source: T_s is the excess over Coulomb friction, F_S - F_C there.
    """

    name = "stribeck_friction"
    told_by = "slow ramps at several speeds: friction just above standstill against friction in motion"
    off: ClassVar[Mapping[str, float] | None] = {"T_s": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"omega_s": (0.1, 0.4, 1.5, 6.0)}
    T_s: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "friction at rest in excess of sliding", "Olsson et al. 1998")
    omega_s: Scalar = parameter("rad/s", Positive(0.5), 0.5, "Stribeck speed of the plate", "Olsson et al. 1998")
    delta_s: Scalar = parameter("1", Positive(1.0), 1.0, "exponent of the Stribeck curve", "Olsson et al. 1998")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(
            friction=u.plate * self.T_s * jnp.exp(-_power(jnp.abs(x.omega) / self.omega_s, self.delta_s))
        )
