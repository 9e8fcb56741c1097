"""Contact drop of the brushes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class BrushVoltageDrop(AbstractEffect):
    """voltage = -V_b tanh(i / i_b): both brushes together, a constant against the current but for a bend at zero.

    Source: Fitzgerald, Kingsley and Umans 2003, ch. 7 (a constant drop); Holm 1967 (voltage over current of a carbon
    contact, which depends on its film). Differs from source: the bend, by which the drop has a slope at no current, is
    a tanh.
    """

    name = "brush_voltage_drop"
    scope = "motor"
    told_by = "resistance tests at currents from a few mA up, in both directions"
    off: ClassVar[Mapping[str, float] | None] = {"V_b": 0.0}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    V_b: Scalar = parameter("V", NonNegative(0.3), 0.0, "contact drop of the brushes", "Fitzgerald et al. 2003, ch. 7")
    i_b: Scalar = parameter("A", Positive(0.05), 0.05, "current that bends the contact drop", "Holm 1967")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(voltage=-self.V_b * jnp.tanh(x.i / self.i_b))
