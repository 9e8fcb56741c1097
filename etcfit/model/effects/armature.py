"""The motor's winding."""

from __future__ import annotations

from ..parameters import Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class Armature(AbstractEffect):
    """Resistance, inductance, back-EMF and motor torque.

        L_a di/dt + (R_a + R_series) i + K_b N omega = v        torque at the plate: N K_m i

    Source: the paper, Eqs. 1 and 2. Differs from source: a series resistance of the rig test's own circuit, which
    the paper's inductance test shows (R_t = 2.731 ohm against R_a = 1.513 ohm).
    """

    name = "armature"
    R_a: Scalar = parameter("ohm", Positive(1.5), 1.513, "armature resistance", "paper, Eq. 1")
    L_a: Scalar = parameter("H", Positive(1.5e-3), 1.475e-3, "armature inductance", "paper, Eq. 1")
    K_b: Scalar = parameter("V*s/rad", Positive(0.02), 0.0189, "back-EMF constant of the motor", "paper, Eq. 1")
    K_m: Scalar = parameter("N*m/A", Positive(0.02), 0.0189, "torque constant of the motor", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(
            voltage=-(self.R_a + u.series) * x.i - self.K_b * u.gear_ratio * x.omega,
            drive=u.gear_ratio * self.K_m * x.i,
            inductance=self.L_a,
        )
