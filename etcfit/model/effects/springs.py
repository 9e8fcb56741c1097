"""Torques on the plate beyond the paper's spring: other springs, a load, and the air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class LimpHomeSpring(AbstractEffect):
    """torque = T_lh S(d) + K_lh d_lh softplus(d), d = (theta_lh - theta)/d_lh, S(d) = 1/(1 + exp(-d)).

    Below the default angle a second, preloaded spring opens the plate against the return spring, so that the engine
    can limp home without the motor: far below that angle the torque is T_lh + K_lh (theta_lh - theta), far above it
        zero.

    Source: Deur, Pavkovic, Peric, Jansz and Hrovat 2004, IEEE Trans. Ind. Appl. 40(3); Grepl and Lee 2010, Int. J.
    Automotive Technology 11(4). Differs from source: the corner is rounded over d_lh, so that its place can be fitted;
    the torque is what the second spring adds to the return spring, not the sum of both.
    """

    name = "limp_home_spring"
    told_by = "a slow ramp through the default position, down to the closed stop"
    off: ClassVar[Mapping[str, float] | None] = {"T_lh": 0.0, "K_lh": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"theta_lh": (0.05, 0.09, 0.13, 0.18, 0.25, 0.35)}
    T_lh: Scalar = parameter("N*m", NonNegative(0.4), 0.0, "preload torque of the limp-home spring", "Deur et al. 2004")
    K_lh: Scalar = parameter("N*m/rad", NonNegative(0.8), 0.0, "stiffness of the limp-home spring", "Deur et al. 2004")
    theta_lh: Scalar = parameter("rad", Positive(0.15), 0.15, "default (limp-home) angle", "Deur et al. 2004")
    d_lh: Scalar = parameter("rad", Positive(0.01), 0.01, "width of the corner at the default angle", "rounded corner")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        below = (self.theta_lh - x.theta) / self.d_lh
        inside = below > 0.0
        small = jnp.exp(jnp.where(inside, -below, below))  # one exponential for both
        share = jnp.where(inside, 1.0, small) / (1.0 + small)
        torque = self.T_lh * share + self.K_lh * self.d_lh * (jnp.where(inside, below, 0.0) + jnp.log1p(small))
        return Contribution(torque=u.plate * torque)


# A return spring that grows stiffer as it is wound up
class StiffeningSpring(AbstractEffect):
    """torque = -K_3 theta^3: coils of a torsion spring that touch each other; negative if the spring softens.

    Over a quarter of a turn gravity on an arm looks the same: theta - sin(theta) is nearly theta^3/6, and the linear
        part
    belongs to K_s and T_PL.

    Source: Duffing 1918, Erzwungene Schwingungen, cubic stiffness. Differs from source: no.
    """

    name = "stiffening_spring"
    told_by = "a slow ramp over the whole travel with the body turned by 180 degrees: a spring does not feel it"
    off: ClassVar[Mapping[str, float] | None] = {"K_3": 0.0}
    inexact: ClassVar[float] = 0.1  # coils touch one after the other, not by a cubic law
    needs: ClassVar[tuple[str, ...]] = ("position",)
    K_3: Scalar = parameter("N*m/rad**3", Real(0.05), 0.0, "cubic stiffness of the return spring", "Duffing 1918")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.K_3 * x.theta**3)


# Gravity on an arm
class GravityLoad(AbstractEffect):
    """torque = -T_g sin(theta): a mass m on an arm of length l, T_g = m g l, theta measured from hanging down.

    Source: statics of a rigid pendulum. Differs from source: no.
    """

    name = "gravity_load"
    told_by = "the same ramp with the body turned by 180 degrees"
    off: ClassVar[Mapping[str, float] | None] = {"T_g": 0.0}
    inexact: ClassVar[float] = 0.1  # the arm does not hang down at exactly angle 0
    needs: ClassVar[tuple[str, ...]] = ("position",)
    T_g: Scalar = parameter("N*m", Real(0.5), 0.0, "largest gravity torque, m g l", "statics of a pendulum")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.T_g * jnp.sin(x.theta))


# Torque of the intake air on the plate
class AirflowTorque(AbstractEffect):
    """torque = -(T_air sin(2 theta) + T_air2 sin(4 theta)); T_air > 0 closes.

    There is no torque on a plate across or along the flow. The first harmonic is largest at 45 degrees; the second,
    with T_air2 < 0, moves the peak towards the open end, where measured valves have it.

    Source: Morris and Dutton 1989, J. Fluids Eng. 111(4), torque of butterfly valves. Differs from source: the first
    two harmonics of the curve only, at a constant pressure drop.
    """

    name = "airflow_torque"
    told_by = "the same ramp with and without air flow"
    off: ClassVar[Mapping[str, float] | None] = {"T_air": 0.0, "T_air2": 0.0}
    inexact: ClassVar[float] = 0.1  # the pressure drop is not constant, and two harmonics are not the whole curve
    needs: ClassVar[tuple[str, ...]] = ("position",)
    T_air: Scalar = parameter("N*m", Real(0.1), 0.0, "torque of the air flow, first harmonic", "Morris and Dutton 1989")
    T_air2: Scalar = parameter(
        "N*m", Real(0.1), 0.0, "torque of the air flow, second harmonic", "Morris and Dutton 1989"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        torque = self.T_air * jnp.sin(2.0 * x.theta) + self.T_air2 * jnp.sin(4.0 * x.theta)
        return Contribution(torque=-u.plate * torque)


# Drag of the air on a fast plate
class QuadraticDrag(AbstractEffect):
    """torque = -D_q omega |omega|.

    Source: Hoerner 1965, Fluid-dynamic drag, turbulent drag of a plate. Differs from source: one lumped coefficient.
    """

    name = "quadratic_drag"
    told_by = "free falls and fast strokes over the whole travel"
    off: ClassVar[Mapping[str, float] | None] = {"D_q": 0.0}
    D_q: Scalar = parameter("N*m*s**2/rad**2", NonNegative(5e-4), 0.0, "drag torque over speed squared", "Hoerner 1965")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.D_q * x.omega * jnp.abs(x.omega))
