"""Sine test: an ECU follows a sine setpoint, one file a frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from . import controlled
from .base import DRIVES, AbstractRigTest, Boundary, Measurement, Reading, RigConfig


@final
class Sine(AbstractRigTest):
    """The plate under its ECU; without a logged drive it is simulated with the ECU of [ecu], and not fitted without."""

    name = "sine"
    title = "Sine setpoints"
    boundary = Boundary()
    drives = DRIVES
    observes = ("current", "position", "motor_speed", "emf")
    needs = (("position", "motor_speed", "current", "emf"),)

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """The inverse model on every trace whose voltage is known, or the gains of the ECU that drives it."""
        return controlled.read(self.title, traces, config, known)
