"""A position sensor whose line is bent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State, fraction

_S_PEAK = 6.0 * math.sqrt(3.0)  # s (1 - s) (1 - 2 s) is largest, 1 / (6 sqrt 3), at s = (1 - 1 / sqrt 3) / 2


class PositionSensorNonlinearity(AbstractEffect):
    """position = 4 E_2 s (1 - s) + 6 sqrt(3) E_3 s (1 - s) (1 - 2 s) with s = (theta - lower) / (upper - lower).

    A bow and an S whose largest values are E_2 and E_3; both vanish at the stops, where the sensor was calibrated.

    Source: Fraden 2016 (nonlinearity against the line through the terminal points). Differs from source: its shape, two
    polynomials.
    """

    name = "position_sensor_nonlinearity"
    scope = "channel"
    told_by = "a slow ramp with a second, trusted angle sensor"
    off: ClassVar[Mapping[str, float] | None] = {"E_2": 0.0, "E_3": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    E_2: Scalar = parameter("rad", Real(0.02), 0.0, "bow of the position sensor's line", "Fraden 2016")
    E_3: Scalar = parameter("rad", Real(0.02), 0.0, "S in the position sensor's line", "Fraden 2016")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        s = fraction(x.theta, u.lower, u.upper)
        bow = s * (1.0 - s)
        return Contribution(position=u.plate * bow * (4.0 * self.E_2 + _S_PEAK * self.E_3 * (1.0 - 2.0 * s)))
