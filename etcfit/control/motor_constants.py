"""kS, kV and kA of a fitted model: what robots' feed-forwards are written with, beside our parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..estimation.fitted_model import Fitted
from ..model.linear import MIDDLE, coefficients, turning_against
from ..model.throttle import Throttle
from .settings import SlidingSettings

SYMBOLS = ("kS", "kV", "kA")
UNITS = ("V", "V s/rad", "V s^2/rad")


@dataclass(frozen=True, eq=False)
class MotorConstants:
    """v = kS sgn(w) + kV w + kA dw/dt, w the speed of the shaft whose angle was logged.

    Of Eqs. 1-2 without their inductance:

        kS = R_a T_f / (N K_m),    kV = N K_b + R_a (N^2 B_m + B_L) / (N K_m),    kA = R_a (N^2 J_m + J_L) / (N K_m)

    Springs and preload have no place in it. Source: WPILib, SimpleMotorFeedforward and its characterization by SysId.
    Differs from source: read off a model whose parameters were fitted, not off a regression of these three.

    Args:
        values: kS (V), kV (V s/rad), kA (V s^2/rad), shape (3,).
        stderr: of these, by the delta method, shape (3,).
    """

    values: np.ndarray
    stderr: np.ndarray


def motor_constants(
    fitted: Fitted, lower: float, upper: float, share: float = MIDDLE, settings: SlidingSettings = SlidingSettings()
) -> MotorConstants:
    """The constants of a model with any effects: kS and kV as `pid.sliding.sliding_of` has friction and rate, the mean
    of both ways over the travel; kA = R_a / (L_a b0) about a share of it.

    Args:
        fitted: the model.
        lower, upper: its travel, rad.
        share: of the travel, for kA.
        settings: the speed, and the places.
    """
    types, gear = fitted.free_parameters.layout.types, fitted.config.gear_ratio
    travel = upper - lower
    angles = lower + travel * (np.arange(settings.places) + 0.5) / settings.places
    speed = settings.rate * travel

    def of(values: Any) -> Any:
        throttle = Throttle.build(types, values)

        def volts(way: float, friction: float) -> Any:
            return jnp.mean(jax.vmap(lambda theta: turning_against(
                throttle, theta, way * speed, friction, gear, lower, upper)[1])(jnp.asarray(angles)))  # fmt: skip

        opens, up, down, closes = volts(1.0, 1.0), volts(1.0, 0.0), volts(-1.0, 0.0), volts(-1.0, -1.0)
        b0 = coefficients(throttle, lower + share * travel, gear, lower, upper)[0]
        return jnp.stack([0.5 * (opens - up + down - closes), (up - down) / (2.0 * speed),
                          values["R_a"] / (values["L_a"] * b0)])  # fmt: skip

    gradient = fitted.gradient(of)
    covariance = gradient @ np.nan_to_num(fitted.covariance, posinf=0.0) @ gradient.T
    at = np.asarray(jax.jit(of)({symbol: jnp.asarray(value) for symbol, value in fitted.values.items()}))
    return MotorConstants(at, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
