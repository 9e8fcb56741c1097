"""The engine computer of a trace that logs a setpoint and no voltage: a PID inside the model."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..ecu import Ecu
from ..parameters import NonNegative, Positive, Scalar, parameter
from ..pid import Gains, Memory, tick
from .base import AbstractComputer, Contribution, Inputs, State

_SOURCE = "Astrom and Hagglund 2006, ch. 3 and 13"
_AT_ONCE = 1e-6  # s, a delay below this counts as none


class Controller(AbstractComputer):
    """The PID of `model.pid.tick`, every t_e, of the setpoint and the angle t_l ago; its output is held until the next
    tick.

    At the begin of the trace, at rest, its output is v_0, which `u.voltage` has: its integral is then v_0 minus the
    feed-forward and minus the output of P at rest. Its memory f begins without a derivative. The angle t_l ago is
    theta - t_l s, ds/dt = (omega - s)/(t_l/2) (Pade (1, 1)). V_e, the limit of its output, is d_e times its supply
    under load, and so determines that supply.

    If `u.controlled` is 0 it contributes nothing. The angle is the one that the sensor shows. An `actuation_delay`
    shifts logged inputs only: the ECU's own delay is t_l.

    Source: Astrom and Hagglund 2006, ch. 3 and 13.
    """

    name = "controller"
    z0: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.0)  # integral minus v_0, s, f and output
    K_p: Scalar = parameter("V/rad", NonNegative(6.0), 6.0, "proportional gain of the ECU", _SOURCE)
    K_i: Scalar = parameter("V/(rad*s)", NonNegative(50.0), 30.0, "integral gain of the ECU", _SOURCE)
    K_d: Scalar = parameter("V*s/rad", NonNegative(0.1), 0.1, "derivative gain of the ECU", _SOURCE)
    t_e: Scalar = parameter("s", Positive(1e-3), 1e-3, "period of the ECU's clock", _SOURCE)
    tau_e: Scalar = parameter("s", NonNegative(2e-3), 2e-3, "derivative filter of the ECU", _SOURCE)
    t_l: Scalar = parameter("s", NonNegative(1e-3), 0.0, "delay from the ECU's reading to its output", _SOURCE)
    V_e: Scalar = parameter("V", Positive(12.0), 12.0, "limit of the ECU's output", _SOURCE)
    d_e: Scalar = parameter("1", Positive(1.0), 1.0, "largest duty of the ECU", _SOURCE)
    I_e: Scalar = parameter("1", NonNegative(1.0), 0.0, "limit of the ECU's integral over its supply; 0: none", _SOURCE)
    S_e: Scalar = parameter("1/s", NonNegative(1.0), 0.0, "limit of its slew over the supply; 0: none", _SOURCE)
    e_0: Scalar = parameter("rad", NonNegative(0.01), 0.0, "error below which the integral is held", _SOURCE)
    b: Scalar = parameter("1", NonNegative(1.0), 1.0, "weight of the setpoint in the ECU's P", _SOURCE)
    c: Scalar = parameter("1", NonNegative(1.0), 1.0, "weight of the setpoint in the ECU's D", _SOURCE)

    def ticked(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> tuple[Scalar, ...]:
        if u.controlled is None:  # it does not act: another computer is simulated, or a constant voltage
            return z
        integral, speed, filtered, output = z
        read, first = x.theta - self.t_l * speed, u.time < 0.5 * self.t_e
        supply = self.V_e / self.d_e
        ecu = Ecu(
            period=self.t_e, supply=supply, filter=self.tau_e, duty=self.d_e, integral=self.I_e, slew=self.S_e * supply,
            dead_band=self.e_0, setpoint_weight=self.b, derivative_weight=self.c,
        )  # fmt: skip
        ahead = u.ahead * supply
        before = Memory(
            u.voltage + jnp.where(first, (1.0 - self.b) * self.K_p * read - ahead, integral),
            jnp.where(first, self.c * u.setpoint - read, filtered),
            jnp.where(first, u.voltage, output),
        )
        volts, after = tick(Gains(self.K_p, self.K_i, self.K_d), ecu, before, u.setpoint, read, ahead)
        return after.integral - u.voltage, speed, after.filtered, volts

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        if u.controlled is None:
            return Contribution(dz=tuple(0.0 * each for each in z))
        _, speed, _, volts = z
        lagging = (x.omega - speed) / (0.5 * jnp.maximum(self.t_l, _AT_ONCE))
        dz = 0.0 * speed, u.controlled * lagging, 0.0 * speed, 0.0 * speed
        return Contribution(voltage=u.controlled * (volts - u.voltage), dz=dz)
