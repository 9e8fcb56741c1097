"""A motor that gives less torque per ampere the more it is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class TorqueSaturation(AbstractEffect):
    """drive = -T m / (1 + m) with m = S_T T^2, T the motor's torque at the plate: T / (1 + S_T T^2) remains.

    The torque constant falls as 1 / (1 + m), even in the current. What remains is largest, and half of T, at
    T = 1 / sqrt(S_T); beyond, where m > 1, the law is not meant to hold.

    Source: Hendershot and Miller 2010 (torque constant under saturation). Differs from source: the first even term of
    the loss alone, over torque instead of current; the back-EMF keeps its constant.
    """

    name = "torque_saturation"
    off: ClassVar[Mapping[str, float] | None] = {"S_T": 0.0}
    loaded: ClassVar[bool] = True
    S_T: Scalar = parameter(
        "1/(N*m)**2", NonNegative(1.0), 0.0, "loss of torque constant over torque squared", "Hendershot and Miller 2010"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        m = self.S_T * u.motor**2
        return Contribution(drive=-u.motor * m / (1.0 + m))
