"""Ziegler and Nichols' second method."""

from __future__ import annotations

from .base import Refusal, Task
from .gains import Gains
from .ultimate import Ultimate, ultimate


def from_ultimate(u: Ultimate) -> Gains:
    """Kp = 0.6 K_u, Ti = P_u / 2, Td = P_u / 8."""
    return Gains.standard(0.6 * u.gain, u.period / 2.0, u.period / 8.0)


def ziegler_nichols(task: Task) -> Gains | Refusal:
    """Kp = 0.6 K_u, Ki = 2 Kp / P_u, Kd = Kp P_u / 8, of the transfer function: what the paper starts from.

    Source: Ziegler and Nichols 1942, Trans. ASME 64; the paper, section 4.2. Differs from source: K_u and P_u are
    computed from the transfer function, with half the ECU's period as delay, not found by raising a gain on the rig.
    """
    u = ultimate(task.plant, task.ecu.late)
    return u if isinstance(u, Refusal) else from_ultimate(u)
