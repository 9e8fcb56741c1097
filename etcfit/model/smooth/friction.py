"""Dry friction of the plate from a cause that nobody has named.

A budget of friction cannot be negative, but what is added to one may be: these contributions take either sign, as long
as the friction of all effects together stays at or above zero. A constant is the Coulomb friction T_f.
"""

from __future__ import annotations

from typing import ClassVar, final

from .axes import ANGLE, LOAD, SPEED, TIME
from .base import smooth


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
