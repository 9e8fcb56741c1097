"""Response test: the plate driven by any logged voltage, duty or torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from . import driven
from .base import DRIVES, AbstractRigTest, Boundary, Measurement, Reading, RigConfig


@final
class Response(AbstractRigTest):
    """Eqs. 1-2 with nothing tied down."""

    name = "response"
    title = "Driven response"
    boundary = Boundary()
    drives = DRIVES
    observes = ("current", "position", "motor_speed", "emf")
    needs = (DRIVES, ("position", "motor_speed", "current", "emf"))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """The inverse model on every trace with a drive."""
        return driven.read(self.title, traces, config, known)
