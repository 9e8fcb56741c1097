"""Dry friction of plate and gear."""

from __future__ import annotations

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class CoulombFriction(AbstractEffect):
    """Budget T_f: the friction torque lies in [-T_f, T_f] at rest and is -T_f sgn(omega) in motion.

    Source: the paper, Eqs. 2 and 5; Olsson et al. 1998, section 2. Differs from source: set-valued at rest.
    """

    name = "coulomb_friction"
    T_f: Scalar = parameter("N*m", NonNegative(0.2), 0.239, "dry friction torque at the plate", "paper, Eq. 5")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(friction=u.plate * self.T_f)
