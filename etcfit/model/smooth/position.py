"""Error of the position sensor from a cause that nobody has named."""

from __future__ import annotations

from typing import ClassVar, final

from .axes import ANGLE
from .base import smooth


@final
class PositionOverAngle(smooth("u_PA", "position", ANGLE)):
    """position(theta): what the sensor reads besides the truth, theta as a share of the travel.

    A constant is an error of the sensor's zero, a straight line one of its gain.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_position_over_angle"
    needs: ClassVar[tuple[str, ...]] = ("position",)
