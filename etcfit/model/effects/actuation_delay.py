"""An input that acts late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class ActuationDelay(AbstractEffect):
    """What drives the throttle at time t is the logged input at t - t_a: computing, PWM, bus.

    The same as a sensor that is late where the position is all that was logged.

    Source: Astrom and Wittenmark 1997 (delay of a computer that controls). Differs from source: no.
    """

    name = "actuation_delay"
    scope = "driver"
    told_by = "steps of the command with the terminal voltage or the current logged fast"
    off: ClassVar[Mapping[str, float] | None] = {"t_a": 0.0}
    inexact: ClassVar[float] = 0.1
    delays: ClassVar[bool] = True
    t_a: Scalar = parameter("s", NonNegative(0.005), 0.0, "delay of the input", "Astrom and Wittenmark 1997")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(input_delay=self.t_a)
