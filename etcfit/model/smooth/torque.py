"""Torque on the plate from a cause that nobody has named."""

from __future__ import annotations

from typing import ClassVar, final

from .axes import ANGLE, DIRECTED_SPEED
from .base import smooth


@final
class TorqueOverAngle(smooth("u_TA", "torque", ANGLE)):
    """torque(theta), theta as a share of the travel. A constant is the preload T_PL, a straight line K_s.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_torque_over_angle"
    needs: ClassVar[tuple[str, ...]] = ("position",)


@final
class TorqueOverSpeed(smooth("u_TS", "torque", DIRECTED_SPEED)):
    """torque(omega), each direction by itself. A constant is the preload T_PL, a straight line viscous friction.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_torque_over_speed"
