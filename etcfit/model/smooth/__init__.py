"""Smooth effects without a name, for what no effect of the catalogue explains; they are not in it."""

from __future__ import annotations

from .axes import Axis, K
from .base import AbstractSmooth
from .friction import FrictionOverAngle, FrictionOverLoad, FrictionOverSpeed, FrictionOverTime
from .position import PositionOverAngle
from .torque import TorqueOverAngle, TorqueOverSpeed
from .voltage import VoltageOverCurrent

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
