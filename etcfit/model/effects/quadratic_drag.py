"""Drag of the air on a fast plate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


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
