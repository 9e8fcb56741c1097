"""A current sensor whose zero is off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class CurrentSensorOffset(AbstractEffect):
    """current = I_0: read besides the true current.

    Source: Ziegler et al. 2009 (offset of current sensors). Differs from source: it does not drift.
    """

    name = "current_sensor_offset"
    scope = "channel"
    told_by = "a log with the terminals open"
    off: ClassVar[Mapping[str, float] | None] = {"I_0": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("current",)
    I_0: Scalar = parameter("A", Real(0.02), 0.0, "zero of the current sensor", "Ziegler et al. 2009")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(current=self.I_0)
