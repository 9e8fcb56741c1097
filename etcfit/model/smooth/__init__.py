"""Smooth effects of unknown causes, for residuals that no effect of the catalogue explains; they are not in it."""

from __future__ import annotations

from .base import AbstractSmooth, Axis, K
from .curves import (
    FrictionOverAngle,
    FrictionOverLoad,
    FrictionOverSpeed,
    FrictionOverTime,
    PositionOverAngle,
    TorqueOverAngle,
    TorqueOverSpeed,
    VoltageOverCurrent,
)

UNKNOWNS: tuple[type[AbstractSmooth], ...] = (
    TorqueOverAngle,
    TorqueOverSpeed,
    FrictionOverAngle,
    FrictionOverSpeed,
    FrictionOverLoad,
    FrictionOverTime,
    VoltageOverCurrent,
    PositionOverAngle,
)

__all__ = ["UNKNOWNS", "AbstractSmooth", "Axis", "K"]
