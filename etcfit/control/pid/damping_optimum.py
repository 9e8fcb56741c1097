"""The damping optimum (double-ratio method)."""

from __future__ import annotations

from .base import Refusal, Task
from .gains import Gains

D = 0.5  # each double ratio a_k a_(k-2) / a_(k-1)^2: damping 0.7 at about 6 % overshoot


def damping_optimum(task: Task) -> Gains | Refusal:
    """The closed loop's polynomial made D2^3 D3^2 D4 Te^4 s^4 + D2^2 D3 Te^3 s^3 + D2 Te^2 s^2 + Te s + 1.

    With the plant b0 / (s^3 + a2 s^2 + a1 s + a0) its coefficients are those of s^4 + a2 s^3 + (a1 + b0 Kd) s^2 +
    (a0 + b0 Kp) s + b0 Ki. D2 = D3 = 1/2, and D4 follows from Te; Te is a sixth of the settling time asked for, less
    where the motor's own damping asks for it (`DampingSettings`), and no less than 8 / a2, where D4 = 1/2.

    Source: Deur, Pavkovic, Peric, Jansz and Hrovat 2004, IEEE Trans. Ind. Appl. 40(3), section III. Differs from
    source: the armature is not neglected, the loop is not sampled, and Te is taken from the requirement.
    """
    plant, settings = task.plant, task.settings.damping
    damped = settings.damped * plant.a2 / (D**2 * plant.a1)
    te = max(1.0 / (D**3 * plant.a2), min(task.requirements.settling_s / settings.settles, damped))
    # s^4 has coefficient 1: divide by D2^3 D3^2 D4 Te^4, in which D4 = 1 / (D2 D3 Te a2)
    ki = plant.a2 / (D**3 * te**3)
    kp, kd = ki * te - plant.a0, ki * D * te**2 - plant.a1
    if min(kp, kd) < 0.0:
        return Refusal("the plant is already faster than the settling time asked for")
    return Gains(kp / plant.b0, ki / plant.b0, kd / plant.b0)
