"""A gear ratio other than the one in rig.toml."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import APART, AbstractRigEffect, Logged, Place, number_of


class GearRatio(AbstractRigEffect):
    """N = (1 + n) N_given. It shows where motor and plate are both seen: the motor alone, and geared.

    Source: the paper's Eq. 2. Differs from source: N is given there.
    """

    kind = "gear_ratio"
    scope = "rig"
    told_by = "teeth counted, or a turn of the motor against the angle of the plate"
    off: ClassVar[Mapping[str, float] | None] = {"gear_error": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("gear",)
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"gear_ratio": lambda factor: factor - 1.0}
    gear_error: Scalar = parameter("", Real(0.05), 0.0, "relative error of the gear ratio given", "Eq. 2")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """The rig, where a motor's speed and a plate's angle were logged."""
        channels = set().union(*logged.values())
        return (Place(),) if {"motor_speed", "position"} <= channels else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return f"[rig] gear_ratio: times {1.0 + value:.4g}"

    @classmethod
    def cured(cls, config: Any, value: float) -> Any | None:
        return replace(config, gear_ratio=(1.0 + value) * config.gear_ratio)

    @classmethod
    def compounded(cls, cured: float, left: float) -> float:
        return (1.0 + cured) * (1.0 + left) - 1.0

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(gear_ratio=(1.0 + self.gear_error) * steps.gear_ratio)

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        """A motor that runs alone began with its speed over the ratio given."""
        factor = jnp.where(test_of == number_of(APART), 1.0 + self.gear_error, 1.0)
        return resets._replace(omega=resets.omega / factor)
