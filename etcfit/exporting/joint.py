"""The throttle as a joint of a physics engine: Eqs. 1-2 with the current in balance at every instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .base import Source, effects_left_out


@dataclass(frozen=True)
class Joint:
    """Constants of a hinge with a DC motor, at the plate where nothing else is said.

    Args:
        armature: inertia of the motor, N^2 J_m, kg m2.
        inertia: of the plate, J_L, kg m2.
        damping: N^2 B_m + B_L, N m s/rad.
        friction: T_f, N m.
        stiffness: K_s, N m/rad.
        rest: angle at which the spring is relaxed, -T_PL/K_s, rad.
        gear: N.
        per_volt: torque of the motor's own shaft, K_m/R_a, N m/V.
        back_emf: K_m K_b/R_a, N m s/rad, at the motor's own shaft.
    """

    armature: float
    inertia: float
    damping: float
    friction: float
    stiffness: float
    rest: float
    gear: float
    per_volt: float
    back_emf: float


_SOFTEST = 1e-6  # N m/rad: a spring that is preload alone still has a rest angle


def joint_of(source: Source) -> Joint:
    """The constants of a model."""
    v, n = source.values, source.body["N"]
    stiffness = max(v["K_s"], _SOFTEST)
    return Joint(
        armature=n**2 * v["J_m"],
        inertia=v["J_L"],
        damping=n**2 * v["B_m"] + v["B_L"],
        friction=v["T_f"],
        stiffness=stiffness,
        rest=-v["T_PL"] / stiffness,
        gear=n,
        per_volt=v["K_m"] / v["R_a"],
        back_emf=v["K_m"] * v["K_b"] / v["R_a"],
    )


def cannot_hold(source: Source) -> Iterator[str]:
    """What such a joint leaves out."""
    v = source.values
    yield (f"The inductance L_a: the current follows the voltage at once instead of within L_a/R_a = "
           f"{1e3 * v['L_a'] / v['R_a']:.2g} ms.")  # fmt: skip
    yield from effects_left_out(source)
