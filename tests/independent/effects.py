"""What a synthetic throttle body can have beyond Eqs. 1-2; every default is exactly off.

The formulas stand in `kernel.py`, next to the equations they enter. A new effect is a NamedTuple of floats here, its
field in `Effects`, its typical strength in `MEDIUM`, and its term in the kernel.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class LimpHomeSpring(NamedTuple):
    """Below the default position the preload changes sign and a stiff second spring pushes the plate open.

    Args:
        angle: default position, rad; the off value lies below any travel.
        stiffness: of the spring below it, N m/rad.
        preload: opening torque just below it, N m.
        corner: half width over which the two springs hand over, rad.
    """

    angle: float = -10.0
    stiffness: float = 0.0
    preload: float = 0.0
    corner: float = 0.01


class StribeckFriction(NamedTuple):
    """Breakaway friction above the running one, decaying as a Lorentzian of speed.

    Args:
        excess: friction at rest over that of motion, N m.
        speed: speed at which half of it is left, rad/s.
    """

    excess: float = 0.0
    speed: float = 1.0


class LoadDependentFriction(NamedTuple):
    """Gear friction in proportion to the torque through the teeth.

    Args:
        share: friction per transmitted torque, dimensionless.
    """

    share: float = 0.0


class CoggingTorque(NamedTuple):
    """The magnets' detent torque, periodic in the motor's angle.

    Args:
        amplitude: at the plate, N m.
        per_turn: detents in one turn of the motor.
        phase: rad.
    """

    amplitude: float = 0.0
    per_turn: float = 6.0
    phase: float = 0.0


class WindingHeating(NamedTuple):
    """The winding warms by its own loss, and its resistance with it; each trace begins cold.

    Args:
        coefficient: relative resistance per kelvin, 1/K (copper 0.0039).
        capacity: of the winding, J/K.
        conductance: to the housing, W/K.
    """

    coefficient: float = 0.0
    capacity: float = 1.0
    conductance: float = 0.0


class Effects(NamedTuple):
    """One of each; named as in FORMAT.md."""

    limp_home_spring: LimpHomeSpring = LimpHomeSpring()
    stribeck_friction: StribeckFriction = StribeckFriction()
    load_dependent_friction: LoadDependentFriction = LoadDependentFriction()
    cogging_torque: CoggingTorque = CoggingTorque()
    winding_heating: WindingHeating = WindingHeating()


NONE = Effects()

# one effect each, of a strength seen on real throttle bodies
MEDIUM: dict[str, Effects] = {
    "limp_home_spring": Effects(limp_home_spring=LimpHomeSpring(math.radians(9.0), 0.9, 0.33, 0.008)),
    "stribeck_friction": Effects(stribeck_friction=StribeckFriction(0.06, 0.5)),
    "load_dependent_friction": Effects(load_dependent_friction=LoadDependentFriction(0.12)),
    "cogging_torque": Effects(cogging_torque=CoggingTorque(0.02, 6.0, 0.7)),
    "winding_heating": Effects(winding_heating=WindingHeating(0.0039, 3.0, 0.15)),
}
