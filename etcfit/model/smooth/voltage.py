"""Voltage in the armature loop from a cause that nobody has named."""

from __future__ import annotations

from typing import ClassVar, final

from .axes import CURRENT
from .base import smooth


@final
class VoltageOverCurrent(smooth("u_VC", "voltage", CURRENT)):
    """voltage(i), each direction by itself, the motor alone included. A straight line is the resistance R_a.

    Source: de Boor 1978, B-splines of order 2. Differs from source: no.
    """

    name = "unknown_voltage_over_current"
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
