"""A bridge that leaves the terminals open in the off time of its PWM."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_SOURCE = "Erickson and Maksimovic 2020, ch. 5"


class CoastingBridge(AbstractEffect):
    """voltage = K_c omega (1 - d - min(1 - d, k_d d)),    d = min(|v|/V_0, 1): what the EMF does not brake while the
    terminals are open.

    In each period of the PWM the bridge drives for a share d; the current then dies within a share k_d d, and for the
    rest the terminals are open. Where it dies at once, the mean of the loop is R i = d (V_0 - K omega) in place of
    d V_0 - K omega: a motor without a load turns nearly as fast at a small duty as at a large one, and nothing brakes a
    plate that falls back with the bridge off. A bridge that shorts the motor in its off time has none of this.

    Source: Erickson and Maksimovic 2020, ch. 5 (discontinuous conduction). Differs from source: k_d is a constant, and
    what the dying current gives back to the supply is left out.
    """

    name = "coasting_bridge"
    scope = "driver"
    told_by = "settled speeds at small duties, or a plate that falls back with the bridge off"
    off: ClassVar[Mapping[str, float] | None] = {"K_c": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"k_d": (0.01, 0.6)}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("circuit", "bridge")
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"coasting_bridge": lambda share: 0.1}
    K_c: Scalar = parameter(
        "V*s/rad", NonNegative(0.1), 0.0, "EMF at the plate that open terminals do not feel", _SOURCE
    )
    k_d: Scalar = parameter("1", Positive(0.5), 0.1, "time in which the current dies over the on time", _SOURCE)
    V_0: Scalar = parameter("V", Positive(12.0), 12.0, "voltage of the bridge at full duty", "supply_V of rig.toml")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        on = jnp.minimum(jnp.abs(u.voltage) / self.V_0, 1.0)
        dying = jnp.minimum(1.0 - on, self.k_d * on)
        return Contribution(voltage=self.K_c * (1.0 - on - dying) * x.omega)
