"""The engine computer of a trace that logs a setpoint and no voltage: a PID inside the model."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_SOURCE = "Astrom and Hagglund 2006, ch. 3 and 13"


class Controller(AbstractEffect):
    """v = clip(v_0 + (K_p + K_i t_e/2) e + I + K_d d, +-V_e), the discrete PID of `model.ecu` with its delays made
    continuous.

        L = t_l + t_e/2                          computing, and a hold that lasts half a period on average
        e = setpoint(t - L) - (theta - L s)      ds/dt = (omega - s)/(L/2): the angle seen late, Pade (1, 1)
        dI/dt = K_i e                            still while v is at its limit and e drives it further
        dd/dt = (dsetpoint/dt - omega - d)/t_d   t_d = tau_e + t_e + t_l: filter, difference over a period, L

    v_0 is what the integral held where the trace began. A discrete integral has e of the tick itself in it, half a
    period early: hence K_i t_e/2. First moments are those of the discrete PID, so errors are of the order of
    (t_e omega)^2 at angular frequency omega; what they amount to: tests/effects/test_controller.py.

    Where `u.controlled` is 0 it contributes nothing. The angle is the one that the sensor shows. An `actuation_delay`
    shifts logged inputs only: the ECU's own delay is t_l.

    Source: Astrom and Hagglund 2006, ch. 3 and 13. Differs from source: continuous; the derivative is of the error.
    """

    name = "controller"
    commands: ClassVar[bool] = True
    z0: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0)
    K_p: Scalar = parameter("V/rad", NonNegative(6.0), 6.0, "proportional gain of the ECU", _SOURCE)
    K_i: Scalar = parameter("V/(rad*s)", NonNegative(50.0), 30.0, "integral gain of the ECU", _SOURCE)
    K_d: Scalar = parameter("V*s/rad", NonNegative(0.1), 0.1, "derivative gain of the ECU", _SOURCE)
    t_e: Scalar = parameter("s", Positive(1e-3), 1e-3, "period of the ECU's clock", _SOURCE)
    tau_e: Scalar = parameter("s", NonNegative(2e-3), 2e-3, "derivative filter of the ECU", _SOURCE)
    t_l: Scalar = parameter("s", NonNegative(1e-3), 0.0, "delay from the ECU's reading to its output", _SOURCE)
    V_e: Scalar = parameter("V", Positive(12.0), 12.0, "limit of the ECU's output", _SOURCE)

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        if u.controlled is None:  # nothing was asked of it: another computer is simulated, or a constant voltage
            return Contribution(dz=tuple(0.0 * each for each in z))
        integral, speed, rate = z
        late = self.t_l + 0.5 * self.t_e
        error = u.setpoint - (x.theta - late * speed)
        wanted = u.voltage + (self.K_p + 0.5 * self.K_i * self.t_e) * error + integral + self.K_d * rate
        volts = jnp.clip(wanted, -self.V_e, self.V_e)
        winding = (wanted - volts) * error > 0.0
        dz = (
            jnp.where(winding, 0.0, self.K_i * error),
            (x.omega - speed) / (0.5 * late),
            (u.setpoint_rate - x.omega - rate) / (self.tau_e + 0.5 * self.t_e + late),
        )
        return Contribution(voltage=u.controlled * (volts - u.voltage), dz=tuple(u.controlled * each for each in dz))
