"""Torque of the intake air on the plate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class AirflowTorque(AbstractEffect):
    """torque = -T_air sin(2 theta): none on a plate across or along the flow, most at 45 degrees; T_air > 0 closes.

    Source: Morris and Dutton 1989, J. Fluids Eng. 111(4), torque of butterfly valves. Differs from source: the first
    harmonic only, at a constant pressure drop.
    """

    name = "airflow_torque"
    told_by = "the same ramp with and without air flow"
    off: ClassVar[Mapping[str, float] | None] = {"T_air": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    T_air: Scalar = parameter("N*m", Real(0.1), 0.0, "largest torque of the air flow", "Morris and Dutton 1989")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.T_air * jnp.sin(2.0 * x.theta))
