"""Cogging of the motor's magnets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class CoggingTorque(AbstractEffect):
    """torque = -(A_c cos(n_c N theta) + A_s sin(n_c N theta)): n_c periods in one turn of the motor.

    Cosine and sine stand for an amplitude and a phase, because a phase means nothing where the amplitude is zero.

    Source: Hanselman 2006, Brushless permanent magnet motor design, 2nd ed., cogging torque. Differs from source: the
    first harmonic only, at the plate; left out for the motor alone, whose angle nobody logs.
    """

    name = "cogging_torque"
    scope = "motor"
    told_by = "slow constant-speed strokes, read against the motor's angle"
    off: ClassVar[Mapping[str, float] | None] = {"A_c": 0.0, "A_s": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "n_c": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 15.0, 16.0, 18.0, 20.0, 24.0),
    }
    needs: ClassVar[tuple[str, ...]] = ("position", "gear")
    A_c: Scalar = parameter("N*m", Real(0.02), 0.0, "cogging torque at the plate, cosine", "Hanselman 2006")
    A_s: Scalar = parameter("N*m", Real(0.02), 0.0, "cogging torque at the plate, sine", "Hanselman 2006")
    n_c: Scalar = parameter("1", Positive(6.0), 6.0, "cogging periods per turn of the motor", "Hanselman 2006")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        phase = self.n_c * u.gear_ratio * x.theta
        return Contribution(torque=-u.plate * (self.A_c * jnp.cos(phase) + self.A_s * jnp.sin(phase)))
