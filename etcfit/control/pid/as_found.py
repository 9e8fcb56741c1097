"""The gains of the ECU that drove the logs: no tuning, but what a tuning must better."""

from __future__ import annotations

from .base import Refusal, Task
from .gains import Gains


def as_found(task: Task) -> Gains | Refusal:
    """Kp, Ki, Kd as [ecu] of rig.toml tells them or the fit found them.

    Source: the rig's own logs (`effects.controller`). Differs from source: they are tried in the task's ECU, whose
    clock, delay and bias curve may be others.
    """
    return task.as_found
