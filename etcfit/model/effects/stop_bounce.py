"""Rebound from the end stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_MOST = 0.95  # a plate that lost nothing would bounce for ever


class StopBounce(AbstractEffect):
    """omega after an impact = -e_r omega before it, e_r at most 0.95.

    Source: Newton's law of impact; Brogliato 2016, Nonsmooth mechanics, 3rd ed. Differs from source: no.
    """

    name = "stop_bounce"
    told_by = "fast strokes onto the stops, sampled at 1 kHz or more"
    off: ClassVar[Mapping[str, float] | None] = {"e_r": 0.0}
    # a small rebound ends within its step, and chi2 has as many valleys as there are rebounds
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"e_r": (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6)}
    e_r: Scalar = parameter(
        "1", NonNegative(0.3), 0.0, "restitution coefficient of the end stops", "Newton's law of impact"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(restitution=u.plate * jnp.minimum(self.e_r, _MOST))
