"""The discrete PID of an engine control unit: its gains, and its computation at each tick of its clock.

Both the controller that drove the logs (`effects.controller`) and the one to be tuned (`control.pid`) use it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .ecu import Ecu
from .parameters import Scalar

UNIT = "V/rad"  # unit of Kp; Ki is per s, Kd times s


class Gains(NamedTuple):
    """v = Kp e + Ki int e dt + Kd de/dt, e the angle's error."""

    Kp: Scalar  # V/rad
    Ki: Scalar  # V/(rad s)
    Kd: Scalar  # V s/rad

    @classmethod
    def stacked(cls, *several: Gains) -> Gains:
        """Several gains as one, of shape (G,)."""
        return cls(*(np.array(column, dtype=float) for column in zip(*several, strict=True)))

    @classmethod
    def standard(cls, Kp: float, Ti: float, Td: float) -> Gains:
        """Gains of the form Kp (1 + 1/(Ti s) + Td s), times in s."""
        return cls(Kp, Kp / Ti, Kp * Td)

    @classmethod
    def series(cls, Kc: float, Ti: float, Td: float) -> Gains:
        """Gains of the form Kc (1 + 1/(Ti s)) (1 + Td s), times in s."""
        return cls(Kc * (1.0 + Td / Ti), Kc / Ti, Kc * Td)


class Memory(NamedTuple):
    """The memory of a PID from tick to tick."""

    integral: Scalar  # integral part, V
    filtered: Scalar  # c r - y after the derivative's low-pass, rad
    output: Scalar  # output before rounding to the PWM's resolution, V

    @classmethod
    def at_rest(cls, gains: Gains, ecu: Ecu, angle: Scalar) -> Memory:
        """The memory for a plate at rest at its setpoint (rad), with an output of zero."""
        still = 0.0 * gains.Kp
        integral = (1.0 - ecu.setpoint_weight) * gains.Kp * angle
        return cls(integral, (ecu.derivative_weight - 1.0) * angle + still, still)


def tick(gains: Gains, ecu: Ecu, memory: Memory, setpoint: Scalar, position: Scalar, bias: Scalar) -> Any:
    """One tick: v = clip(clip(Kp (b r - y) + I + Kd d, V) + bias, limit), slewed, and rounded to the PWM's resolution.

        I <- I + Ki T e where |e| >= dead band,    d = ((c r - y) - f) / (T_f + T),    f <- f + T d

    with f as `Memory.filtered`, e = r - y, and b and c the weights of the setpoint. The integral is held while the
    output is at its limit, that of its slew included, and the error would drive it further (anti-windup); or it is
    clamped itself, if the ECU does that (`Ecu.integral`).

    Source: Astrom and Hagglund 2006, Advanced PID Control, ch. 3 and 13. Differs from source: the integral includes the
    error of the present tick, as in the ECUs.

    Args:
        setpoint, position: r and y, rad.
        bias: feed-forward, V.
    """
    seen = quantised(position, ecu.resolution)
    error, tracked = setpoint - seen, ecu.derivative_weight * setpoint - seen
    derivative = (tracked - memory.filtered) / (ecu.filter + ecu.period)
    grown = memory.integral + gains.Ki * ecu.period * error
    integral = jnp.where(jnp.abs(error) >= ecu.dead_band, grown, memory.integral)
    clamped = jnp.clip(integral, -ecu.integral * ecu.supply, ecu.integral * ecu.supply)
    integral = jnp.where(ecu.integral > 0.0, clamped, integral)
    wanted = gains.Kp * (ecu.setpoint_weight * setpoint - seen) + integral + gains.Kd * derivative
    volts = jnp.clip(jnp.clip(wanted, -ecu.supply, ecu.supply) + bias, -ecu.limit, ecu.limit)
    volts = slewed(volts, memory.output, ecu)
    winding = ((wanted + bias - volts) * error > 0.0) & (ecu.integral == 0.0)
    integral = jnp.where(winding, memory.integral, integral)
    return quantised(volts, ecu.pwm), Memory(integral, memory.filtered + ecu.period * derivative, volts)


def slewed(volts: Scalar, before: Scalar, ecu: Ecu) -> Scalar:
    """The output limited to its slew, one tick after it was `before`, V."""
    most = ecu.slew * ecu.period
    return jnp.where(ecu.slew > 0.0, jnp.clip(volts, before - most, before + most), volts)


def quantised(value: Scalar, step: Scalar) -> Scalar:
    """The nearest multiple of the step; the value itself if the step is 0."""
    return jnp.where(step > 0.0, step * jnp.round(value / jnp.where(step > 0.0, step, 1.0)), value)
