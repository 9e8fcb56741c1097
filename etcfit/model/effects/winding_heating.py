"""The winding warms, and its resistance with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class WindingHeating(AbstractEffect):
    """voltage = -r_h q i with dq/dt = i^2 - q / tau_h, q(0) = 0: each trace begins cold.

    A winding of heat capacity C (J/K), warmer than its surroundings by D, obeys C dD/dt = R_a i^2 - C D / tau_h, and
    its resistance is R_a (1 + alpha D). With q = C D / R_a (A2 s) that is R_a + r_h q, where r_h = alpha R_a^2 / C;
    alpha = 0.0039 / K for copper.

    Source: Boglietti et al. 2009 (thermal networks of machines). Differs from source: one node; the heat that the
    growth of the resistance adds is left out.
    """

    name = "winding_heating"
    scope = "motor"
    told_by = "a resistance test held for several times the winding's time constant"
    off: ClassVar[Mapping[str, float] | None] = {"r_h": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"tau_h": (0.5, 2.0, 8.0, 30.0)}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    r_h: Scalar = parameter(
        "ohm/(A**2*s)", NonNegative(3e-3), 0.0, "growth of the resistance, alpha R_a^2 / C", "Boglietti et al. 2009"
    )
    tau_h: Scalar = parameter("s", Positive(5.0), 5.0, "time in which the winding cools", "Boglietti et al. 2009")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        (q,) = z
        return Contribution(voltage=-self.r_h * q * x.i, dz=(x.i**2 - q / self.tau_h,))
