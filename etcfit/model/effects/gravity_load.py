"""Gravity on an arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class GravityLoad(AbstractEffect):
    """torque = -T_g sin(theta): a mass m on an arm of length l, T_g = m g l, theta measured from hanging down.

    Source: statics of a rigid pendulum. Differs from source: no.
    """

    name = "gravity_load"
    told_by = "the same ramp with the body turned by 180 degrees"
    off: ClassVar[Mapping[str, float] | None] = {"T_g": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    T_g: Scalar = parameter("N*m", Real(0.5), 0.0, "largest gravity torque, m g l", "statics of a pendulum")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-u.plate * self.T_g * jnp.sin(x.theta))
