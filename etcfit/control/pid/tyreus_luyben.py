"""Tyreus and Luyben's settings."""

from __future__ import annotations

from .base import Refusal, Task
from .gains import Gains
from .ultimate import ultimate


def tyreus_luyben(task: Task) -> Gains | Refusal:
    """Kp = K_u / 2.2, Ti = 2.2 P_u, Td = P_u / 6.3: Ziegler and Nichols' with far less integral action.

    Source: Luyben and Luyben 1997, Essentials of Process Control, ch. 3. Luyben 1996, Ind. Eng. Chem. Res. 35(10), has
    0.46 K_u, later textbooks 0.45; Tyreus and Luyben 1992, ibid. 31(11), gives the PI settings alone. Differs from
    source: half the ECU's period counts as delay.
    """
    u = ultimate(task.plant, task.ecu.late)
    return u if isinstance(u, Refusal) else Gains.standard(u.gain / 2.2, 2.2 * u.period, u.period / 6.3)
