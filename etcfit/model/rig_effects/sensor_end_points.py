"""A position sensor whose calibration is off: its angles at the stops are not those of the plate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


class SensorEndPoints(AbstractRigEffect):
    """position = (1 + g) theta + d in every test.

    Source: GUM (JCGM 100:2008), 4.3: systematic errors of scale and zero. Differs from source: no.
    """

    kind = "sensor_end_points"
    scope = "rig"
    acts_on: ClassVar[tuple[str, ...]] = ("position",)
    told_by = "the plate pressed on each stop by hand"
    off: ClassVar[Mapping[str, float] | None] = {"position_gain": 0.0, "position_zero": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    position_gain: Scalar = parameter("", Real(0.02), 0.0, "relative error of the angle's scale", "JCGM 100:2008, 4.3")
    position_zero: Scalar = parameter("rad", Real(0.02), 0.0, "angle shown at angle 0", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """The rig, where an angle is logged beside what goes with a speed by the motor's own constant.

        By a torque alone a scale of the angle is one of inertia, friction and spring.
        """
        told = any(
            "position" in channels and channels & {"voltage", "emf", "motor_speed"} for channels in logged.values()
        )
        return (Place(),) if told else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return f"[tps] closed_V and open_V, or [rig] travel_deg: angles read {100.0 * value:+.3g} % off"

    def _true(self, shown: Scalar) -> Scalar:
        return (shown - self.position_zero) / (1.0 + self.position_gain)

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(target0=self._true(steps.target0), target1=self._true(steps.target1))

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        return resets._replace(theta=resets.begins * self._true(resets.theta))

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        return seen | {"position": (1.0 + self.position_gain) * seen["position"] + self.position_zero}
