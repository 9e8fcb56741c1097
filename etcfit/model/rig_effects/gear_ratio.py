"""A gear ratio other than the one in rig.toml."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


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

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(gear_ratio=(1.0 + self.gear_error) * steps.gear_ratio)
