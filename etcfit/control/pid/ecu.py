"""The discrete PID of an engine control unit: what it computes at each tick of its clock."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from ...model.ecu import Ecu
from ...model.parameters import Scalar
from .gains import Gains


class Memory(NamedTuple):
    """What a PID remembers from tick to tick: integral (V), filtered derivative (rad/s), last error (rad)."""

    integral: Scalar
    derivative: Scalar
    error: Scalar


def tick(gains: Gains, ecu: Ecu, memory: Memory, setpoint: Scalar, position: Scalar, bias: Scalar) -> Any:
    """One tick: v = clip(clip(Kp e + I + Kd d, V) + bias, limit), rounded to the PWM's resolution.

        I <- I + Ki T e,    d <- (T_f d + e - e_last) / (T_f + T)

    The integral stands still while the output is at its limit and the error would drive it further (anti-windup), or
    is clamped itself, where the ECU does that (`Ecu.integral`).

    Source: Astrom and Hagglund 2006, Advanced PID Control, ch. 3 and 13. Differs from source: the derivative is of the
    error, as in the ECUs that have but one setpoint weight, 1.

    Args:
        gains, ecu, memory: see there.
        setpoint, position: rad.
        bias: feed-forward, V.
    Returns:
        voltage and the new memory.
    """
    error = setpoint - quantised(position, ecu.resolution)
    derivative = (ecu.filter * memory.derivative + error - memory.error) / (ecu.filter + ecu.period)
    integral = memory.integral + gains.Ki * ecu.period * error
    clamped = jnp.clip(integral, -ecu.integral * ecu.supply, ecu.integral * ecu.supply)
    integral = jnp.where(ecu.integral > 0.0, clamped, integral)
    wanted = gains.Kp * error + integral + gains.Kd * derivative
    volts = jnp.clip(jnp.clip(wanted, -ecu.supply, ecu.supply) + bias, -ecu.limit, ecu.limit)
    winding = ((wanted + bias - volts) * error > 0.0) & (ecu.integral == 0.0)
    integral = jnp.where(winding, memory.integral, integral)
    return quantised(volts, ecu.pwm), Memory(integral, derivative, error)


def quantised(value: Scalar, step: Scalar) -> Scalar:
    """The nearest multiple of the step; the value itself where there is none."""
    return jnp.where(step > 0.0, step * jnp.round(value / jnp.where(step > 0.0, step, 1.0)), value)
