"""The return spring."""

from __future__ import annotations

from ..parameters import NonNegative, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class ReturnSpring(AbstractEffect):
    """torque = -(K_s theta + T_PL): a linear spring, preloaded towards closed.

    Source: the paper, Eqs. 2 and 5. Differs from source: no.
    """

    name = "return_spring"
    K_s: Scalar = parameter("N*m/rad", NonNegative(0.15), 0.150, "stiffness of the return spring", "paper, Eq. 5")
    T_PL: Scalar = parameter("N*m", Real(0.4), 0.362, "preload torque of the return spring", "paper, Eq. 5")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * (self.K_s * x.theta + self.T_PL))
