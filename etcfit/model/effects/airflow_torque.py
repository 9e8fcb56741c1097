"""Torque of the intake air on the plate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class AirflowTorque(AbstractEffect):
    """torque = -(T_air sin(2 theta) + T_air2 sin(4 theta)); T_air > 0 closes.

    None on a plate across or along the flow. The first harmonic is largest at 45 degrees; the second, where T_air2 < 0,
    moves the peak towards the open end, where measured valves have it.

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
