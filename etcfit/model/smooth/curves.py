"""All smooth effects: the part of the contribution and the axis of each."""

from __future__ import annotations

from typing import ClassVar, final

from .base import ANGLE, CURRENT, DIRECTED_SPEED, LOAD, SPEED, TIME, smooth


# Torque on the plate from an unknown cause
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


# Dry friction of the plate from an unknown cause. A budget of friction cannot be negative, but a contribution to it may
# be: these contributions have either sign, as long as the friction of all effects together stays at or above zero. A
# constant is the Coulomb friction T_f
@final
class FrictionOverAngle(smooth("u_FA", "friction", ANGLE)):
    """friction(theta), theta as a share of the travel; of either sign as long as the total stays >= 0.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_friction_over_angle"
    needs: ClassVar[tuple[str, ...]] = ("position",)


@final
class FrictionOverSpeed(smooth("u_FS", "friction", SPEED)):
    """friction(|omega|); of either sign as long as the total stays >= 0.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_friction_over_speed"


@final
class FrictionOverLoad(smooth("u_FL", "friction", LOAD)):
    """friction(|T_g|), T_g the torque through the gear; of either sign as long as the total stays >= 0.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_friction_over_load"


@final
class FrictionOverTime(smooth("u_FT", "friction", TIME)):
    """friction(t), t since the trace began; of either sign as long as the total stays >= 0.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_friction_over_time"


# Voltage in the armature loop from an unknown cause
@final
class VoltageOverCurrent(smooth("u_VC", "voltage", CURRENT)):
    """voltage(i), each direction by itself, the motor alone included. A straight line is the resistance R_a.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_voltage_over_current"
    needs: ClassVar[tuple[str, ...]] = ("circuit",)


# Error of the position sensor from an unknown cause
@final
class PositionOverAngle(smooth("u_PA", "position", ANGLE)):
    """position(theta): error of the reading, theta as a share of the travel.

    A constant is an error of the sensor's zero, a straight line one of its gain.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_position_over_angle"
    needs: ClassVar[tuple[str, ...]] = ("position",)
