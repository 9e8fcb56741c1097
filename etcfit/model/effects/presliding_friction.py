"""Friction that yields before it slides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class PreslidingFriction(AbstractEffect):
    """torque = -T_z s, ds/dt = (omega - |omega| s)/delta_z: a contact of stiffness T_z/delta_z that slides at T_z.

    The memory s is the share of T_z that the contact carries; each trace begins with the contact unloaded. It adds to
    the set-valued friction T_f, which does not yield.

    Source: Dahl 1968, A solid friction model, TOR-0158(3107-18)-1; Canudas de Wit, Olsson, Astrom and Lischinsky 1995,
    IEEE Trans. Autom. Control 40(3). Differs from source: no Stribeck effect and no damping of the bristles.
    """

    name = "presliding_friction"
    told_by = "small slow reversals that stay within a degree"
    off: ClassVar[Mapping[str, float] | None] = {"T_z": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"delta_z": (0.001, 0.004, 0.016)}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    T_z: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "friction torque of the yielding contact", "Dahl 1968")
    delta_z: Scalar = parameter("rad", Positive(0.005), 0.005, "plate angle over which the contact yields", "Dahl 1968")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        rate = (x.omega - jnp.abs(x.omega) * z[0]) / self.delta_z
        return Contribution(torque=-u.plate * self.T_z * z[0], dz=(rate,))
