"""A position sensor with a low-pass filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_FASTEST = 1e-9  # s; a shorter filter divides by this instead of zero, and none could be told from it


class PositionSensorLag(AbstractEffect):
    """position = -tau_p s with ds/dt = (omega - s) / tau_p: the reading y obeys tau_p dy/dt = theta - y.

    The memory s is the rate of the reading, and e = theta - y = tau_p s what it is behind, de/dt = omega - e / tau_p.
    Kept as s it tends to omega where tau_p tends to 0, so that the off value has a derivative, -omega. Each trace
    begins with a settled filter.

    Source: Doebelin 2003, ch. 3 (instrument of first order). Differs from source: no.
    """

    name = "position_sensor_lag"
    scope = "channel"
    told_by = "fast motion with an EMF or a motor speed logged beside the position"
    off: ClassVar[Mapping[str, float] | None] = {"tau_p": 0.0}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    hidden: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("position",)
    tau_p: Scalar = parameter(
        "s", NonNegative(0.005), 0.0, "time constant of the position sensor", "Doebelin 2003, ch. 3"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        (s,) = z
        rate = (x.omega - s) / jnp.maximum(self.tau_p, _FASTEST)
        return Contribution(position=-u.plate * self.tau_p * s, dz=(rate,))
