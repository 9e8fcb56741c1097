"""The engine computer of a trace that logs a setpoint and no voltage: a PID inside the model."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractComputer, Contribution, Inputs, State

_SOURCE = "Astrom and Hagglund 2006, ch. 3 and 13"
_AT_ONCE = 1e-6  # s, a delay that is none


class Controller(AbstractComputer):
    """The discrete PID of `model.ecu`: at each tick, every t_e,

        e = setpoint(t - t_l) - theta(t - t_l)
        d = (e - f)/(tau_e + t_e),        f <- f + t_e d
        v = clip(v_0 + K_p e + I + K_i t_e e + K_d d, +-V_e)
        I <- I + K_i t_e e                still while v is at its limit and e drives it further

    and v is held until the next one. v_0 is what the integral held where the trace began; f, the error filtered, begins
    as e. The angle t_l ago is theta - t_l s, ds/dt = (omega - s)/(t_l/2) (Pade (1, 1)).

    Where `u.controlled` is 0 it contributes nothing. The angle is the one that the sensor shows. An `actuation_delay`
    shifts logged inputs only: the ECU's own delay is t_l.

    Source: Astrom and Hagglund 2006, ch. 3 and 13. Differs from source: the derivative is of the error.
    """

    name = "controller"
    z0: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.0)  # I, s, f and v
    K_p: Scalar = parameter("V/rad", NonNegative(6.0), 6.0, "proportional gain of the ECU", _SOURCE)
    K_i: Scalar = parameter("V/(rad*s)", NonNegative(50.0), 30.0, "integral gain of the ECU", _SOURCE)
    K_d: Scalar = parameter("V*s/rad", NonNegative(0.1), 0.1, "derivative gain of the ECU", _SOURCE)
    t_e: Scalar = parameter("s", Positive(1e-3), 1e-3, "period of the ECU's clock", _SOURCE)
    tau_e: Scalar = parameter("s", NonNegative(2e-3), 2e-3, "derivative filter of the ECU", _SOURCE)
    t_l: Scalar = parameter("s", NonNegative(1e-3), 0.0, "delay from the ECU's reading to its output", _SOURCE)
    V_e: Scalar = parameter("V", Positive(12.0), 12.0, "limit of the ECU's output", _SOURCE)

    def ticked(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> tuple[Scalar, ...]:
        if u.controlled is None:  # nothing was asked of it: another computer is simulated, or a constant voltage
            return z
        integral, speed, filtered, _ = z
        error = u.setpoint - (x.theta - self.t_l * speed)
        filtered = jnp.where(u.time < 0.5 * self.t_e, error, filtered)
        rate = (error - filtered) / (self.tau_e + self.t_e)
        more = self.K_i * self.t_e * error
        wanted = u.voltage + self.K_p * error + integral + more + self.K_d * rate
        volts = jnp.clip(wanted, -self.V_e, self.V_e)
        winding = (wanted - volts) * error > 0.0
        return integral + jnp.where(winding, 0.0, more), speed, filtered + self.t_e * rate, volts

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        if u.controlled is None:
            return Contribution(dz=tuple(0.0 * each for each in z))
        _, speed, _, volts = z
        lagging = (x.omega - speed) / (0.5 * jnp.maximum(self.t_l, _AT_ONCE))
        dz = 0.0 * speed, u.controlled * lagging, 0.0 * speed, 0.0 * speed
        return Contribution(voltage=u.controlled * (volts - u.voltage), dz=dz)
