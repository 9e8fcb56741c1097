"""Effects of the driver, the winding and the motor's constant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


# Contact drop of the brushes
class BrushVoltageDrop(AbstractEffect):
    """voltage = -V_b tanh(i / i_b): both brushes together, a constant against the current except for a bend at zero.

    Source: Fitzgerald, Kingsley and Umans 2003, ch. 7 (a constant drop); Holm 1967 (voltage over current of a carbon
    contact, which depends on its film). Differs from source: the bend, which gives the drop a slope at zero current, is
    a tanh.
    """

    name = "brush_voltage_drop"
    scope = "motor"
    told_by = "resistance tests at currents from a few mA up, in both directions"
    off: ClassVar[Mapping[str, float] | None] = {"V_b": 0.0}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    V_b: Scalar = parameter("V", NonNegative(0.3), 0.0, "contact drop of the brushes", "Fitzgerald et al. 2003, ch. 7")
    i_b: Scalar = parameter("A", Positive(0.05), 0.05, "current that bends the contact drop", "Holm 1967")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(voltage=-self.V_b * jnp.tanh(x.i / self.i_b))


# The winding warms, and its resistance with it
class WindingHeating(AbstractEffect):
    """voltage = -r_h q i with dq/dt = i^2 - q / tau_h, q(0) = 0: each trace begins cold.

    A winding of heat capacity C (J/K), warmer than its surroundings by D, obeys C dD/dt = R_a i^2 - C D / tau_h, and
    its resistance is R_a (1 + alpha D). With q = C D / R_a (A2 s) that is R_a + r_h q, where r_h = alpha R_a^2 / C;
    alpha = 0.0039 / K for copper.

    Source: Boglietti et al. 2009 (thermal networks of machines). Differs from source: one node; the additional heat of
    the grown resistance is left out.
    """

    name = "winding_heating"
    scope = "motor"
    told_by = "a resistance test held for several times the winding's time constant"
    off: ClassVar[Mapping[str, float] | None] = {"r_h": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"tau_h": (0.5, 2.0, 8.0, 30.0)}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    r_h: Scalar = parameter(
        "ohm/(A**2*s)", NonNegative(3e-3), 0.0, "growth of the resistance, alpha R_a^2 / C", "Boglietti et al. 2009"
    )
    tau_h: Scalar = parameter("s", Positive(5.0), 5.0, "time in which the winding cools", "Boglietti et al. 2009")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        (q,) = z
        return Contribution(voltage=-self.r_h * q * x.i, dz=(x.i**2 - q / self.tau_h,))


# A driver that swallows small voltages
class DriverDeadZone(AbstractEffect):
    """voltage = -sgn(v) min(|v|, V_d): nothing reaches the winding while |v| < V_d, and v - V_d sgn v beyond.

    It equals a brush drop as long as voltage and current have the same sign; small voltages, and a motor that is driven
    back, distinguish them.

    Source: Tao and Kokotovic 1996 (dead zone of an actuator). Differs from source: slope 1, and symmetric.
    """

    name = "driver_dead_zone"
    scope = "driver"
    told_by = "small voltages of either sign, or the plate driven against its motor"
    off: ClassVar[Mapping[str, float] | None] = {"V_d": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("circuit",)
    V_d: Scalar = parameter("V", NonNegative(0.3), 0.0, "voltage that the driver swallows", "Tao and Kokotovic 1996")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        # jnp.clip has no derivative in V_d for v < 0 at V_d = 0, where its two limits meet
        return Contribution(voltage=-jnp.sign(u.voltage) * jnp.minimum(jnp.abs(u.voltage), self.V_d))


_SOURCE = "Erickson and Maksimovic 2020, ch. 5"


# A bridge that leaves the terminals open in the off time of its PWM
class CoastingBridge(AbstractEffect):
    """voltage = K_c omega (1 - d - b) - b V_0 sgn v,    d = min(|v|/V_0, 1),    b = min(k_d d, 1 - d)

    In each period of the PWM the bridge drives the motor for a share d, its current flows back into the supply for a
    share b until it is zero, and for the rest the terminals are open: there the EMF does not brake. If the current
    falls to zero at once, the mean of the loop is R i = d (V_0 - K omega) instead of d V_0 - K omega: a motor without a
    load turns nearly as fast at a small duty as at a large one, and nothing brakes a plate that falls back with the
    bridge off. A bridge that shorts the motor in its off time shows none of these effects.

    Source: Erickson and Maksimovic 2020, ch. 5 (discontinuous conduction). Differs from source: k_d is a constant.
    """

    name = "coasting_bridge"
    scope = "driver"
    told_by = "settled speeds at small duties, or a plate that falls back with the bridge off"
    off: ClassVar[Mapping[str, float] | None] = {"K_c": 0.0, "k_d": 0.0}
    inexact: ClassVar[float] = 0.1
    needs: ClassVar[tuple[str, ...]] = ("circuit", "bridge")
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"coasting_bridge": lambda share: 0.1}
    K_c: Scalar = parameter(
        "V*s/rad", NonNegative(0.1), 0.0, "EMF at the plate that open terminals do not feel", _SOURCE
    )
    k_d: Scalar = parameter("1", NonNegative(0.5), 0.0, "time in which the current dies over the on time", _SOURCE)
    V_0: Scalar = parameter("V", Positive(12.0), 12.0, "voltage of the bridge at full duty", "supply_V of rig.toml")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        on = jnp.minimum(jnp.abs(u.voltage) / self.V_0, 1.0)
        back = jnp.where(
            self.k_d * on < 1.0 - on, self.k_d * on, 1.0 - on
        )  # at full duty the derivative in k_d is zero
        unfelt = self.K_c * (1.0 - on - back) * x.omega
        return Contribution(voltage=unfelt - back * self.V_0 * jnp.sign(u.voltage))


# An input that acts late
class ActuationDelay(AbstractEffect):
    """The input at time t is the logged input at t - t_a: computing, PWM, bus.

    If only the position was logged, it cannot be distinguished from a late sensor.

    Source: Astrom and Wittenmark 1997 (delay of a computer that controls). Differs from source: no.
    """

    name = "actuation_delay"
    scope = "driver"
    told_by = "steps of the command with the terminal voltage or the current logged fast"
    off: ClassVar[Mapping[str, float] | None] = {"t_a": 0.0}
    inexact: ClassVar[float] = 0.1
    delays: ClassVar[bool] = True
    t_a: Scalar = parameter("s", NonNegative(0.005), 0.0, "delay of the input", "Astrom and Wittenmark 1997")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(input_delay=self.t_a)


# A motor that gives less torque per ampere the more it is loaded
class TorqueSaturation(AbstractEffect):
    """drive = -T (1 - 1 / sqrt(1 + 2 S_T T^2)), T the motor's torque at the plate: T / sqrt(1 + 2 S_T T^2) remains.

    The loss begins as S_T T^3; for any current no more than 1 / sqrt(2 S_T) remains.

    Source: Hendershot and Miller 2010 (torque constant under saturation). Differs from source: the first even term of
    the loss only, over torque instead of current; the back-EMF constant is unchanged.
    """

    name = "torque_saturation"
    scope = "motor"
    told_by = "static loads at large currents, or a torque sensor"
    off: ClassVar[Mapping[str, float] | None] = {"S_T": 0.0}
    loaded: ClassVar[bool] = True
    S_T: Scalar = parameter(
        "1/(N*m)**2", NonNegative(0.1), 0.0, "loss of torque constant over torque squared", "Hendershot and Miller 2010"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        excess = 2.0 * self.S_T * u.motor**2
        root = jnp.sqrt(1.0 + excess)
        lost = excess / (root * (1.0 + root))  # 1 - 1/root, without cancellation for a small loss
        return Contribution(drive=-u.motor * lost)
