"""The paper's model, its Eqs. 1-2: always there."""

from __future__ import annotations

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


# The motor's winding
class Armature(AbstractEffect):
    """Resistance, inductance, back-EMF and motor torque.

        L_a di/dt + (R_a + R_series) i + K_b N omega = v        torque at the plate: N K_m i

    Source: the paper, Eqs. 1 and 2. Differs from source: a series resistance of the rig test's own circuit, which
    the paper's inductance test shows (R_t = 2.731 ohm against R_a = 1.513 ohm).
    """

    name = "armature"
    R_a: Scalar = parameter("ohm", Positive(1.5), 1.513, "armature resistance", "paper, Eq. 1")
    L_a: Scalar = parameter("H", Positive(1.5e-3), 1.475e-3, "armature inductance", "paper, Eq. 1")
    K_b: Scalar = parameter("V*s/rad", Positive(0.02), 0.0189, "back-EMF constant of the motor", "paper, Eq. 1")
    K_m: Scalar = parameter("N*m/A", Positive(0.02), 0.0189, "torque constant of the motor", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(
            voltage=-(self.R_a + u.series) * x.i - self.K_b * u.gear_ratio * x.omega,
            drive=u.gear_ratio * self.K_m * x.i,
            inductance=self.L_a,
        )


class Inertia(AbstractEffect):
    """J_eq = N^2 J_m + J_L at the plate; the motor alone carries only J_m.

    Source: the paper, Eq. 2. Differs from source: no.
    """

    name = "inertia"
    J_m: Scalar = parameter("kg*m2", Positive(1e-6), 1.4e-6, "moment of inertia of the motor", "paper, Eq. 2")
    J_L: Scalar = parameter("kg*m2", NonNegative(1e-3), 6e-4, "moment of inertia of the plate", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(inertia=u.gear_ratio**2 * self.J_m + u.plate * self.J_L)


# Viscous friction of motor and plate
class ViscousFriction(AbstractEffect):
    """torque = -(N^2 B_m + B_L) omega; the motor alone feels only B_m.

    Source: the paper, Eq. 2. Differs from source: no.
    """

    name = "viscous_friction"
    B_m: Scalar = parameter("N*m*s/rad", NonNegative(2e-5), 2e-5, "viscous friction of the motor", "paper, Eq. 2")
    B_L: Scalar = parameter("N*m*s/rad", NonNegative(2e-3), 0.0, "viscous friction of the plate", "paper, Eq. 2")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-(u.gear_ratio**2 * self.B_m + u.plate * self.B_L) * x.omega)


class ReturnSpring(AbstractEffect):
    """torque = -(K_s theta + T_PL): a linear spring, preloaded towards closed.

    Source: the paper, Eqs. 2 and 5. Differs from source: no.
    """

    name = "return_spring"
    K_s: Scalar = parameter("N*m/rad", NonNegative(0.15), 0.150, "stiffness of the return spring", "paper, Eq. 5")
    T_PL: Scalar = parameter("N*m", Real(0.4), 0.362, "preload torque of the return spring", "paper, Eq. 5")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * (self.K_s * x.theta + self.T_PL))


# Dry friction of plate and gear
class CoulombFriction(AbstractEffect):
    """Budget T_f: the friction torque lies in [-T_f, T_f] at rest and is -T_f sgn(omega) in motion.

    Source: the paper, Eqs. 2 and 5; Olsson et al. 1998, section 2. Differs from source: set-valued at rest.
    """

    name = "coulomb_friction"
    T_f: Scalar = parameter("N*m", NonNegative(0.2), 0.239, "dry friction torque at the plate", "paper, Eq. 5")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(friction=u.plate * self.T_f)


class EndStops(AbstractEffect):
    """lower <= theta <= upper, without rebound; the travel is the rig's (`travel_deg`), not fitted.

    Source: the paper, Table 1 (0 and 90 degrees). Differs from source: no.
    """

    name = "end_stops"

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        fitted = u.plate > 0.5
        return Contribution(lower=jnp.where(fitted, u.lower, -jnp.inf), upper=jnp.where(fitted, u.upper, jnp.inf))
