"""Mechanical end stops."""

from __future__ import annotations

import jax.numpy as jnp

from ..parameters import Scalar
from .base import AbstractEffect, Contribution, Inputs, State


class EndStops(AbstractEffect):
    """lower <= theta <= upper, without rebound; the travel is the rig's (`travel_deg`), not fitted.

    Source: the paper, Table 1 (0 and 90 degrees). Differs from source: no.
    """

    name = "end_stops"

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        fitted = u.plate > 0.5
        return Contribution(lower=jnp.where(fitted, u.lower, -jnp.inf), upper=jnp.where(fitted, u.upper, jnp.inf))
