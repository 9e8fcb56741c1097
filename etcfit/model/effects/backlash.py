"""Play between the teeth of the gear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_CONTACT = 0.02  # torque through the teeth, N m, below which they are not firmly in contact


class Backlash(AbstractEffect):
    """position = g_b (1 - s)/2, ds/dt = (tanh(T_g / 0.02 N m) - s)/t_b, T_g the torque through the teeth.

    The memory s is the flank in contact: 1 where the motor opens the plate, -1 where it closes it; each trace begins
    with 1. theta is where the motor has the plate; the plate itself, which the sensor reads, lags by s g_b/2. If g_b is
    negative, the sensor sits on the motor's side. Nothing is seen unless the load of the gear changes sign.

    Source: Nordin and Gutman 2002, Automatica 38(10), the dead-zone model. Differs from source: quasi-static.
    """

    name = "backlash"
    told_by = "reversals of the load of the gear: the plate driven through its default position"
    off: ClassVar[Mapping[str, float] | None] = {"g_b": 0.0}
    z0: ClassVar[tuple[float, ...]] = (1.0,)
    loaded: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("position",)
    g_b: Scalar = parameter("rad", Real(0.01), 0.0, "play of the gear, at the plate", "Nordin and Gutman 2002")
    t_b: Scalar = parameter("s", Positive(0.005), 0.005, "time the plate takes to cross the play", "quasi-static play")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        rate = (jnp.tanh(u.gear_load / _CONTACT) - z[0]) / self.t_b
        return Contribution(position=0.5 * u.plate * self.g_b * (1.0 - z[0]), dz=(rate,))
