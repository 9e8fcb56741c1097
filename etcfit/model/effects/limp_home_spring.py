"""The limp-home spring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class LimpHomeSpring(AbstractEffect):
    """torque = T_lh S(d) + K_lh d_lh softplus(d), d = (theta_lh - theta)/d_lh, S(d) = 1/(1 + exp(-d)).

    Below the default angle a second, preloaded spring opens the plate against the return spring, so that the engine
    can limp home with the motor dead: far below it the torque is T_lh + K_lh (theta_lh - theta), far above it nothing.

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
