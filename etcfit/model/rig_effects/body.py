"""Errors in rig.toml's data of the body and of its sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import APART, AbstractRigEffect, Logged, Place, number_of


# A gear ratio other than the one in rig.toml
class GearRatio(AbstractRigEffect):
    """N = (1 + n) N_given. It shows if there are traces of both the motor alone and the geared motor.

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
        """The rig, if a motor's speed and a plate's angle were logged."""
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
        """The initial speed of a motor that runs alone, corrected for the given ratio."""
        factor = jnp.where(test_of == number_of(APART), 1.0 + self.gear_error, 1.0)
        return resets._replace(omega=resets.omega / factor)


# A position sensor whose calibration is off: its angles at the stops are not those of the plate
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
        """The rig, if an angle is logged together with a signal that is tied to the speed by the motor's own constant.

        With a torque alone, a scale of the angle equals a scale of inertia, friction and spring.
        """
        tied_to_speed = any(
            "position" in channels and channels & {"voltage", "emf", "motor_speed"} for channels in logged.values()
        )
        return (Place(),) if tied_to_speed else ()

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


# Traces of another rig: another body, or this one after something was changed
class OtherRig(AbstractRigEffect):
    """One trace, or one test, is of a body with parameters of its own: it is not fitted with the others.

    It changes nothing in the model; if rig.toml names it, those traces are set aside (`RigConfig.sets_aside`).

    Source: mixed-up files. Differs from source: no.
    """

    kind = "other_rig"
    scope = "trace"
    told_by = "the serial number on the body, or that trace measured again"
    off: ClassVar[Mapping[str, float] | None] = {}
    # no `places`: `diagnosis.other_rig` tests it in another way than effects
