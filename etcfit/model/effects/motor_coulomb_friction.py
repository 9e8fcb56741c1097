"""Dry friction of brushes and motor bearings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class MotorCoulombFriction(AbstractEffect):
    """friction = N T_m at the plate; the motor alone feels it too, which tells it from T_f.

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7). Differs from source: reflected
    through the gear, and set-valued at rest.
    """

    name = "motor_coulomb_friction"
    scope = "motor"
    told_by = "a motor-alone test (viscous/, gear apart) at low speeds"
    off: ClassVar[Mapping[str, float] | None] = {"T_m": 0.0}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("gear",)
    T_m: Scalar = parameter(
        "N*m", NonNegative(0.005), 0.0, "dry friction torque at the motor", "Armstrong-Helouvry et al. 1994"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(friction=u.gear_ratio * self.T_m)
