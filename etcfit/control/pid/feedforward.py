"""Feed-forward: the voltage that holds each position, and the dry friction of the way ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...model.linear import holding_against
from ...model.throttle import Throttle

POINTS = 8  # of rusEFI's bias curve
_STILL = 1e-3  # rad/s; a setpoint that moves more slowly stands


@dataclass(frozen=True, eq=False)
class Bias:
    """bias(r) + V_f sgn(dr/dt): spring, preload and limp-home spring by the curve, dry friction by the sign.

    Source: rusEFI, electronic_throttle.cpp (bias table over the target position); Deur et al. 2004 (friction). Differs
    from source: the friction goes with the setpoint's motion, not with a relay on the error.

    Args:
        angles: rad, shape (P,).
        hold: V that hold the plate there in the middle of its dry friction, shape (P,).
        friction: V to either side, the mean over the angles.
    """

    angles: np.ndarray
    hold: np.ndarray
    friction: float = 0.0

    def volts(self, setpoint: np.ndarray, period: float) -> np.ndarray:
        """Of a setpoint sampled at a period (s), rad, shape (K,); V."""
        rate = np.diff(setpoint, append=setpoint[-1]) / period
        way = np.where(np.abs(rate) > _STILL, np.sign(rate), 0.0)
        return np.interp(setpoint, self.angles, self.hold) + self.friction * way


@jax.jit
def _holds(throttle: Throttle, angles: np.ndarray, share: float, gear_ratio: float, lower: float, upper: float):
    return jax.vmap(lambda theta: holding_against(throttle, theta, share, gear_ratio, lower, upper)[1])(angles)


class HoldingVoltages(NamedTuple):
    """Voltages that hold a plate at some angles, V, shape (K,) each.

    Args:
        down: at which it is about to close.
        middle: in the middle of its dry friction.
        up: at which it is about to open.
    """

    down: np.ndarray
    middle: np.ndarray
    up: np.ndarray


def hold_curve(
    throttle: Throttle, angles: np.ndarray, gear_ratio: float, lower: float, upper: float
) -> HoldingVoltages:
    """Voltages that hold a plate at these angles (rad), shape (K,), between stops (rad)."""
    down, middle, up = (np.asarray(_holds(throttle, jnp.asarray(angles), share, gear_ratio, lower, upper))
                        for share in (-1.0, 0.0, 1.0))  # fmt: skip
    return HoldingVoltages(down, middle, up)


def bias_of(throttle: Throttle, gear_ratio: float, lower: float, upper: float, points: int = POINTS) -> Bias:
    """The curve of so many points that follows the holding voltage best.

    The points lie evenly along the curve, each half weighed by the angle and half by the voltage, so that the limp-home
    spring's corner, where the voltage leaps, is not cut.
    """
    fine = np.linspace(lower, upper, 721)
    down, middle, up = hold_curve(throttle, fine, gear_ratio, lower, upper)
    leap = np.abs(np.diff(middle))
    along = np.diff(fine) / (upper - lower) + leap / max(float(leap.sum()), 1e-12)
    place = np.concatenate(([0.0], np.cumsum(along)))
    angles = np.interp(np.linspace(0.0, place[-1], points), place, fine)
    return Bias(angles, np.interp(angles, fine, middle), float(np.mean(0.5 * (up - down))))
