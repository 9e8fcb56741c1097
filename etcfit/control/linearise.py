"""Linearises a fitted model to the third-order transfer function that the paper uses for tuning, with standard errors.

The result follows from Eqs. 1-2; the paper's own Eq. 8 does not follow from its Table 2 (`linear.PAPER_EQ_8`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..backend import compiled_quickly
from ..errors import UsageError
from ..estimation.fitted_model import Fitted
from ..model.linear import MIDDLE, TransferFunction, coefficients, holding, sensor_lag, turning_against
from ..model.throttle import Throttle
from .pid.feedforward import SLIDING_PLACES
from .settings import SlidingSettings

INPUTS = {"V": "voltage", "%": "duty"}
OUTPUTS = ("rad", "deg", "%")


@dataclass(frozen=True, eq=False)
class Reduction:
    """The linear plant of a fitted model."""

    plant: TransferFunction  # transfer function, with delay and sensor lag as separate numbers
    stderr: np.ndarray  # of b0, a2, a1, a0, shape (4,)
    covariance: np.ndarray  # of b0, a2, a1, a0, shape (4, 4)
    input_unit: str  # "V" or "%" (of duty)
    output_unit: str  # "rad", "deg" or "%" (of travel)
    theta: float  # operating point, rad
    # current, volts: they hold the plate there in the middle of its dry friction
    current: float
    volts: float
    share: float  # of the travel at the operating point
    constants: MotorConstants | None = None  # kS, kV and kA; None where they were not requested

    def to_control(self, pade_order: int = 0) -> Any:
        """The plant as a python-control TransferFunction; with delay and sensor lag where a Pade order is given."""
        return self.plant.to_control(pade_order)


def reduce(fitted: Fitted, input_unit: str = "V", output_unit: str = "rad", share: float = MIDDLE) -> Reduction:
    """Linearise a fitted model about a plate held at a share of its travel.

    The standard errors are those of the delta method, sqrt(g C g) with g the gradient in coordinates.

    Args:
        input_unit, output_unit: see `INPUTS` and `OUTPUTS`.
        share: share of the travel; without stops, of a quarter turn.
    Raises:
        UsageError: an unknown unit, or duty as the input where rig.toml gives no supply.
    """
    factor, theta = _factor(fitted, input_unit, output_unit), _angle(fitted, share)
    types, body = fitted.free_parameters.layout.types, (fitted.config.gear_ratio, *fitted.config.stops)
    plant, (current, volts) = _plant_and_hold(fitted, theta, factor)

    def coefficients_at(values: Any) -> Any:
        return coefficients(Throttle.build(types, values), theta, *body)

    gradient = np.array([factor, 1.0, 1.0, 1.0])[:, None] * fitted.value_and_gradient(coefficients_at)[1]
    covariance = gradient @ np.nan_to_num(fitted.covariance, posinf=0.0) @ gradient.T
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Reduction(plant, stderr, covariance, input_unit, output_unit, theta, current, volts, share)


def linear_plant(fitted: Fitted, share: float = MIDDLE) -> TransferFunction:
    """The plant of `reduce` alone, in rad/V, without standard errors."""
    return _plant_and_hold(fitted, _angle(fitted, share), 1.0)[0]


def _angle(fitted: Fitted, share: float) -> float:
    """Angle at a share of the travel, rad."""
    lower, upper = fitted.config.stops
    return lower + share * (upper - lower)


def _plant_and_hold(fitted: Fitted, theta: float, factor: float) -> tuple[TransferFunction, tuple[float, float]]:
    """The plant about an angle (rad), its output over its input `factor` times that in rad/V, and current (A) and
    voltage (V) that hold the plate there."""
    row, (current, volts) = _about(fitted.throttle, theta, fitted.config.gear_ratio, *fitted.config.stops)
    b0, a2, a1, a0 = (np.array([factor, 1.0, 1.0, 1.0]) * np.asarray(row) + 0.0).tolist()  # no spring: 0, not -0
    delay = float(np.asarray(fitted.throttle.delays().input))
    plant = TransferFunction(b0, a2, a1, a0, delay, float(np.asarray(sensor_lag(fitted.throttle))))
    return plant, (float(current), float(volts))


@compiled_quickly
def _about(throttle: Throttle, theta: float, gear_ratio: float, lower: float, upper: float) -> Any:
    """Coefficients, and current and voltage that hold the plate."""
    body = (gear_ratio, lower, upper)
    return coefficients(throttle, theta, *body), holding(throttle, theta, *body)


def _factor(fitted: Fitted, input_unit: str, output_unit: str) -> float:
    """Factor from rad/V to output over input."""
    if input_unit not in INPUTS:
        raise UsageError(f"input in {input_unit!r} is not known. It must be V or % (of duty).")
    if output_unit not in OUTPUTS:
        raise UsageError(f"output in {output_unit!r} is not known. It must be rad, deg or % (of travel).")
    lower, upper = fitted.config.stops
    supply = fitted.config.supply_V
    if input_unit == "%" and supply is None:
        raise UsageError("input in % of duty needs supply_V in [rig] of rig.toml. Add it, or choose V.")
    per_input = (supply or 0.0) / 100.0 if input_unit == "%" else 1.0
    return per_input * {"rad": 1.0, "deg": 180.0 / math.pi, "%": 100.0 / (upper - lower)}[output_unit]


SYMBOLS = ("kS", "kV", "kA")
UNITS = ("V", "V s/rad", "V s^2/rad")


@dataclass(frozen=True, eq=False)
class MotorConstants:
    """v = kS sgn(w) + kV w + kA dw/dt, w the speed of the shaft whose angle was logged.

    From Eqs. 1-2 without their inductance:

        kS = R_a T_f / (N K_m),    kV = N K_b + R_a (N^2 B_m + B_L) / (N K_m),    kA = R_a (N^2 J_m + J_L) / (N K_m)

    Springs and preload are not included. Source: WPILib, SimpleMotorFeedforward and its characterization by SysId.
    Differs from source: computed from a fitted model, not by a regression of these three.
    """

    values: np.ndarray  # kS (V), kV (V s/rad), kA (V s^2/rad), shape (3,)
    stderr: np.ndarray  # of these, by the delta method, shape (3,)


def motor_constants(
    fitted: Fitted, lower: float, upper: float, share: float = MIDDLE, settings: SlidingSettings = SlidingSettings()
) -> MotorConstants:
    """The constants of a model with any effects: kS and kV from friction and rate as in `pid.feedforward.sliding_of`,
    the mean of both directions over the travel; kA = R_a / (L_a b0) about a share of it.
    """
    types, gear = fitted.free_parameters.layout.types, fitted.config.gear_ratio
    travel = upper - lower
    angles = lower + travel * (np.arange(SLIDING_PLACES) + 0.5) / SLIDING_PLACES
    speed = settings.rate * travel

    def constants(values: Any) -> Any:
        throttle = Throttle.build(types, values)

        def volts(way: float, friction: float) -> Any:
            return jnp.mean(jax.vmap(lambda theta: turning_against(
                throttle, theta, way * speed, friction, gear, lower, upper)[1])(jnp.asarray(angles)))  # fmt: skip

        opens, up, down, closes = volts(1.0, 1.0), volts(1.0, 0.0), volts(-1.0, 0.0), volts(-1.0, -1.0)
        b0 = coefficients(throttle, lower + share * travel, gear, lower, upper)[0]
        return jnp.stack([0.5 * (opens - up + down - closes), (up - down) / (2.0 * speed),
                          values["R_a"] / (values["L_a"] * b0)])  # fmt: skip

    at, gradient = fitted.value_and_gradient(constants)
    covariance = gradient @ np.nan_to_num(fitted.covariance, posinf=0.0) @ gradient.T
    return MotorConstants(at, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
