"""A return spring that grows stiffer as it is wound up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class StiffeningSpring(AbstractEffect):
    """torque = -K_3 theta^3: coils of a torsion spring that come to lie on each other; negative where it softens.

    Over a quarter of a turn gravity on an arm looks the same: theta - sin(theta) is nearly theta^3/6, and straight
    lines belong to K_s and T_PL.

    Source: Duffing 1918, Erzwungene Schwingungen, cubic stiffness. Differs from source: no.
    """

    name = "stiffening_spring"
    told_by = "a slow ramp over the whole travel with the body turned by 180 degrees: a spring does not feel it"
    off: ClassVar[Mapping[str, float] | None] = {"K_3": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    K_3: Scalar = parameter("N*m/rad**3", Real(0.05), 0.0, "cubic stiffness of the return spring", "Duffing 1918")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.K_3 * x.theta**3)
