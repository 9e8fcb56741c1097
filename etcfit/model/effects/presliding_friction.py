"""Friction that yields before it slides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class PreslidingFriction(AbstractEffect):
    """torque = -T_z (s + tau_z ds/dt), ds/dt = (omega - |omega| s)/delta_z: a contact of stiffness T_z/delta_z that
    slides at T_z, damped while it yields.

    The memory s is the share of T_z that the contact carries; each trace begins with the contact unloaded. It adds to
    the set-valued friction T_f, which does not yield. Without damping a plate at rest swings on its contact for long.

    Source: Dahl 1968, A solid friction model, TOR-0158(3107-18)-1; Canudas de Wit, Olsson, Astrom and Lischinsky 1995,
    IEEE Trans. Autom. Control 40(3), with sigma_1 = T_z tau_z/delta_z. Differs from source: no Stribeck effect.
    """

    name = "presliding_friction"
    told_by = "small slow reversals that stay within a degree"
    off: ClassVar[Mapping[str, float] | None] = {"T_z": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"delta_z": (0.001, 0.004, 0.016)}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    T_z: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "friction torque of the yielding contact", "Dahl 1968")
    delta_z: Scalar = parameter("rad", Positive(0.005), 0.005, "plate angle over which the contact yields", "Dahl 1968")
    tau_z: Scalar = parameter(
        "s", NonNegative(0.01), 0.0, "damping over stiffness of the yielding contact", "Canudas de Wit et al. 1995"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        rate = (x.omega - jnp.abs(x.omega) * z[0]) / self.delta_z
        return Contribution(torque=-u.plate * self.T_z * (z[0] + self.tau_z * rate), dz=(rate,))
