"""Viscous friction of motor and plate."""

from __future__ import annotations

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class ViscousFriction(AbstractEffect):
    """torque = -(N^2 B_m + B_L) omega; the motor alone feels only B_m.

    Source: the paper, Eq. 2. Differs from source: no.
    """

    name = "viscous_friction"
    B_m: Scalar = parameter("N*m*s/rad", NonNegative(2e-5), 2e-5, "viscous friction of the motor", "paper, Eq. 2")
    B_L: Scalar = parameter("N*m*s/rad", NonNegative(2e-3), 0.0, "viscous friction of the plate", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-(u.gear_ratio**2 * self.B_m + u.plate * self.B_L) * x.omega)
