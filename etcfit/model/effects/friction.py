"""Dry friction that is not constant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_AT_REST = 1e-12  # share of the Stribeck speed below which a power would have no finite slope
_VANISHED = 6.0  # log of the largest power that differs from infinity: exp(-exp(6)) = 1e-175
_NO_LOAD = 1e-12  # N m, below which the load of a contact counts as none


def _power(ratio: Scalar, exponent: Scalar) -> Scalar:
    """ratio^exponent for ratio >= 0, with finite derivatives at a plate at rest and at any exponent."""
    log = exponent * jnp.log(jnp.maximum(ratio, _AT_REST))
    return jnp.exp(jnp.minimum(log, _VANISHED))


# Stribeck friction: what sticks holds faster than what slides
class StribeckFriction(AbstractEffect):
    """friction = T_s exp(-(|omega| / omega_s)^delta_s), on top of the Coulomb friction T_f: T_f + T_s at rest.

    Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, Eur. J. Control 4(3), section 2.
    Differs from source: T_s is the excess over Coulomb friction, F_S - F_C there.
    """

    name = "stribeck_friction"
    told_by = "slow ramps at several speeds: friction just above standstill against friction in motion"
    off: ClassVar[Mapping[str, float] | None] = {"T_s": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"omega_s": (0.1, 0.4, 1.5, 6.0)}
    T_s: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "friction at rest in excess of sliding", "Olsson et al. 1998")
    omega_s: Scalar = parameter("rad/s", Positive(0.5), 0.5, "Stribeck speed of the plate", "Olsson et al. 1998")
    delta_s: Scalar = parameter("1", Positive(1.0), 1.0, "exponent of the Stribeck curve", "Olsson et al. 1998")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(
            friction=u.plate * self.T_s * jnp.exp(-_power(jnp.abs(x.omega) / self.omega_s, self.delta_s))
        )


# Friction told apart by direction
class AsymmetricFriction(AbstractEffect):
    """torque = -(T_a + B_a |omega|): opening meets T_f + T_a and B + B_a, closing T_f - T_a and B - B_a.

    T_a alone IS a shift of the preload T_PL: (T_f + T_a sgn omega) sgn omega = T_f sgn omega + T_a, moving or stuck.
    No test of the throttle separates the two; only B_a can be determined.

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7). Differs from source: the mean of the
    two directions is the Coulomb and viscous friction of Eq. 2, so that this is half their difference.
    """

    name = "asymmetric_friction"
    told_by = "fast strokes in both directions, opening and closing alike"
    inexact: ClassVar[float] = 0.1
    off: ClassVar[Mapping[str, float] | None] = {"T_a": 0.0, "B_a": 0.0}
    T_a: Scalar = parameter(
        "N*m",
        Real(0.2),
        0.0,
        "half the dry friction by which opening exceeds closing",
        "Armstrong-Helouvry et al. 1994",
    )
    B_a: Scalar = parameter(
        "N*m*s/rad",
        Real(0.01),
        0.0,
        "half the viscous friction by which opening exceeds closing",
        "Armstrong-Helouvry et al. 1994",
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * (self.T_a + self.B_a * jnp.abs(x.omega)))


# Friction of the loaded gear
class LoadDependentFriction(AbstractEffect):
    """friction = mu_g |T_g|, T_g = (T_motor - T_external)/2 the torque through the teeth, at the plate.

    Source: Duclusaud, Passault, Padois and Ly 2024, Extended friction models for the physics simulation of servo
    actuators (Rhoban BAM), the load-dependent model. Differs from source: the load is the mean of both sides rather
    than their difference, so that mu_g is twice the coefficient there.
    """

    name = "load_dependent_friction"
    told_by = "the same motion at different spring loads, or with a weight on the lever"
    off: ClassVar[Mapping[str, float] | None] = {"mu_g": 0.0}
    inexact: ClassVar[float] = 0.1
    loaded: ClassVar[bool] = True
    mu_g: Scalar = parameter(
        "1", NonNegative(0.1), 0.0, "dry friction per torque through the gear", "Duclusaud et al. 2024"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(friction=u.plate * self.mu_g * jnp.abs(u.gear_load))


# Dry friction of brushes and motor bearings
class MotorCoulombFriction(AbstractEffect):
    """friction = N T_m at the plate; it also acts on the motor alone, which distinguishes it from T_f.

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7). Differs from source: reflected
    through the gear, and set-valued at rest.
    """

    name = "motor_coulomb_friction"
    scope = "motor"
    told_by = "a motor-alone test (viscous/, gear apart) at low speeds"
    off: ClassVar[Mapping[str, float] | None] = {"T_m": 0.0}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("gear",)
    T_m: Scalar = parameter(
        "N*m", NonNegative(0.005), 0.0, "dry friction torque at the motor", "Armstrong-Helouvry et al. 1994"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(friction=u.gear_ratio * self.T_m)


# Friction that yields before it slides
class PreslidingFriction(AbstractEffect):
    """torque = -T_z (s + tau_z ds/dt), ds/dt = (omega - |omega| s)/delta_z: a contact of stiffness T_z/delta_z that
    slides at T_z, damped while it yields.

    The memory s is the share of T_z that the contact carries. A trace begins with a plate at rest, whose contact
    carries the load T as far as it can: s = T / max(|T|, T_z). It adds to the set-valued friction T_f, which does not
    yield. Without damping a plate at rest oscillates on its contact.

    Source: Dahl 1968, A solid friction model, TOR-0158(3107-18)-1; Canudas de Wit, Olsson, Astrom and Lischinsky 1995,
    IEEE Trans. Autom. Control 40(3), with sigma_1 = T_z tau_z/delta_z. Differs from source: no Stribeck effect.
    """

    name = "presliding_friction"
    told_by = "small slow reversals that stay within a degree"
    off: ClassVar[Mapping[str, float] | None] = {"T_z": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"delta_z": (0.001, 0.004, 0.016)}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    T_z: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "friction torque of the yielding contact", "Dahl 1968")
    delta_z: Scalar = parameter("rad", Positive(0.005), 0.005, "plate angle over which the contact yields", "Dahl 1968")
    tau_z: Scalar = parameter(
        "s", NonNegative(0.01), 0.0, "damping over stiffness of the yielding contact", "Canudas de Wit et al. 1995"
    )

    def first(self, load: Scalar) -> tuple[Scalar, ...]:
        return (load / jnp.maximum(jnp.maximum(jnp.abs(load), self.T_z), _NO_LOAD),)

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        rate = (x.omega - jnp.abs(x.omega) * z[0]) / self.delta_z
        return Contribution(torque=-u.plate * self.T_z * (z[0] + self.tau_z * rate), dz=(rate,))
