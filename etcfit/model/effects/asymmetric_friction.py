"""Friction told apart by direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class AsymmetricFriction(AbstractEffect):
    """torque = -(T_a + B_a |omega|): opening meets T_f + T_a and B + B_a, closing T_f - T_a and B - B_a.

    T_a alone IS a shift of the preload T_PL: (T_f + T_a sgn omega) sgn omega = T_f sgn omega + T_a, moving or stuck.
    No test of the throttle tells the two apart; only B_a is seen.

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7). Differs from source: the mean of the
    two directions is the Coulomb and viscous friction of Eq. 2, so that this is half their difference.
    """

    name = "asymmetric_friction"
    told_by = "fast strokes in both directions, opening and closing alike"
    inexact: ClassVar[float] = 0.1
    off: ClassVar[Mapping[str, float] | None] = {"T_a": 0.0, "B_a": 0.0}
    T_a: Scalar = parameter(
        "N*m",
        Real(0.2),
        0.0,
        "half the dry friction by which opening exceeds closing",
        "Armstrong-Helouvry et al. 1994",
    )
    B_a: Scalar = parameter(
        "N*m*s/rad",
        Real(0.01),
        0.0,
        "half the viscous friction by which opening exceeds closing",
        "Armstrong-Helouvry et al. 1994",
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * (self.T_a + self.B_a * jnp.abs(x.omega)))
