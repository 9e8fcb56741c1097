"""Moments of inertia."""

from __future__ import annotations

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class Inertia(AbstractEffect):
    """J_eq = N^2 J_m + J_L at the plate; the motor alone carries only J_m.

    Source: the paper, Eq. 2. Differs from source: no.
    """

    name = "inertia"
    J_m: Scalar = parameter("kg*m2", Positive(1e-6), 1.4e-6, "moment of inertia of the motor", "paper, Eq. 2")
    J_L: Scalar = parameter("kg*m2", NonNegative(1e-3), 6e-4, "moment of inertia of the plate", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(inertia=u.gear_ratio**2 * self.J_m + u.plate * self.J_L)
