"""Friction of the loaded gear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


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
