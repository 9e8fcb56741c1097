"""A driver that swallows small voltages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class DriverDeadZone(AbstractEffect):
    """voltage = -sgn(v) min(|v|, V_d): nothing reaches the winding while |v| < V_d, and v - V_d sgn v beyond.

    The same as a brush drop while voltage and current share a sign; small voltages tell them apart, and a motor that
    is driven back.

    Source: Tao and Kokotovic 1996 (dead zone of an actuator). Differs from source: slope 1, and the same either way.
    """

    name = "driver_dead_zone"
    scope = "driver"
    told_by = "small voltages of either sign, or the plate driven against its motor"
    off: ClassVar[Mapping[str, float] | None] = {"V_d": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    V_d: Scalar = parameter("V", NonNegative(0.3), 0.0, "voltage that the driver swallows", "Tao and Kokotovic 1996")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        # jnp.clip has no slope along V_d for v < 0 where V_d = 0: its two limits meet there
        return Contribution(voltage=-jnp.sign(u.voltage) * jnp.minimum(jnp.abs(u.voltage), self.V_d))
