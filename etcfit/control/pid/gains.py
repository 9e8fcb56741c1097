"""The three gains of a PID controller."""

from __future__ import annotations

from typing import NamedTuple

from ...model.parameters import Scalar

UNIT = "V/rad"  # of Kp; Ki is per s, Kd times s


class Gains(NamedTuple):
    """v = Kp e + Ki int e dt + Kd de/dt, e the angle's error.

    Args:
        Kp: V/rad.
        Ki: V/(rad s).
        Kd: V s/rad.
    """

    Kp: Scalar
    Ki: Scalar
    Kd: Scalar

    @classmethod
    def standard(cls, Kp: float, Ti: float, Td: float) -> Gains:
        """Of the form Kp (1 + 1/(Ti s) + Td s), times in s."""
        return cls(Kp, Kp / Ti, Kp * Td)

    @classmethod
    def series(cls, Kc: float, Ti: float, Td: float) -> Gains:
        """Of the form Kc (1 + 1/(Ti s)) (1 + Td s), times in s."""
        return cls(Kc * (1.0 + Td / Ti), Kc / Ti, Kc * Td)
