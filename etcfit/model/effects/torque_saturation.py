"""A motor that gives less torque per ampere the more it is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class TorqueSaturation(AbstractEffect):
    """drive = -T (1 - 1 / sqrt(1 + 2 S_T T^2)), T the motor's torque at the plate: T / sqrt(1 + 2 S_T T^2) remains.

    The loss begins as S_T T^3; however large the current, no more than 1 / sqrt(2 S_T) remains.

    Source: Hendershot and Miller 2010 (torque constant under saturation). Differs from source: the first even term of
    the loss alone, over torque instead of current; the back-EMF keeps its constant.
    """

    name = "torque_saturation"
    scope = "motor"
    told_by = "static loads at large currents, or a torque sensor"
    off: ClassVar[Mapping[str, float] | None] = {"S_T": 0.0}
    loaded: ClassVar[bool] = True
    S_T: Scalar = parameter(
        "1/(N*m)**2", NonNegative(0.1), 0.0, "loss of torque constant over torque squared", "Hendershot and Miller 2010"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        excess = 2.0 * self.S_T * u.motor**2
        root = jnp.sqrt(1.0 + excess)
        lost = excess / (root * (1.0 + root))  # 1 - 1/root, but does not cancel for a small loss
        return Contribution(drive=-u.motor * lost)
