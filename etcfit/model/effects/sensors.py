"""Errors of the sensors and of the logger."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State, fraction

_FASTEST = 1e-9  # s; a shorter filter divides by this instead of zero, with no visible difference


# A position sensor with a low-pass filter
class PositionSensorLag(AbstractEffect):
    """position = -tau_p s with ds/dt = (omega - s) / tau_p: the reading y obeys tau_p dy/dt = theta - y.

    The memory s is the rate of the reading, and e = theta - y = tau_p s is its lag, de/dt = omega - e / tau_p. The
    memory s tends to omega as tau_p tends to 0, so that the off value has a derivative, -omega. Each trace begins with
    a settled filter.

    Source: Doebelin 2003, ch. 3 (instrument of first order). Differs from source: no.
    """

    name = "position_sensor_lag"
    scope = "channel"
    told_by = "fast motion with an EMF or a motor speed logged beside the position"
    off: ClassVar[Mapping[str, float] | None] = {"tau_p": 0.0}
    z0: ClassVar[tuple[float, ...]] = (0.0,)
    hidden: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("position",)
    tau_p: Scalar = parameter(
        "s", NonNegative(0.005), 0.0, "time constant of the position sensor", "Doebelin 2003, ch. 3"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        (s,) = z
        rate = (x.omega - s) / jnp.maximum(self.tau_p, _FASTEST)
        return Contribution(position=-u.plate * self.tau_p * s, dz=(rate,))


_S_PEAK = 6.0 * math.sqrt(3.0)  # s (1 - s) (1 - 2 s) is largest, 1 / (6 sqrt 3), at s = (1 - 1 / sqrt 3) / 2


# A position sensor whose line is bent
class PositionSensorNonlinearity(AbstractEffect):
    """position = 4 E_2 s (1 - s) + 6 sqrt(3) E_3 s (1 - s) (1 - 2 s) with s = (theta - lower) / (upper - lower).

    A bow and an S whose largest values are E_2 and E_3; both vanish at the stops, where the sensor was calibrated.

    Source: Fraden 2016 (nonlinearity against the line through the terminal points). Differs from source: its shape, two
    polynomials.
    """

    name = "position_sensor_nonlinearity"
    scope = "channel"
    told_by = "a slow ramp with a second, trusted angle sensor"
    off: ClassVar[Mapping[str, float] | None] = {"E_2": 0.0, "E_3": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("position",)
    E_2: Scalar = parameter("rad", Real(0.02), 0.0, "bow of the position sensor's line", "Fraden 2016")
    E_3: Scalar = parameter("rad", Real(0.02), 0.0, "S in the position sensor's line", "Fraden 2016")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        s = fraction(x.theta, u.lower, u.upper)
        bow = s * (1.0 - s)
        return Contribution(position=u.plate * bow * (4.0 * self.E_2 + _S_PEAK * self.E_3 * (1.0 - 2.0 * s)))


# A current sensor whose zero is off
class CurrentSensorOffset(AbstractEffect):
    """current = I_0: added to the true current in the reading.

    Source: Ziegler et al. 2009 (offset of current sensors). Differs from source: it does not drift.
    """

    name = "current_sensor_offset"
    scope = "channel"
    told_by = "a log with the terminals open"
    off: ClassVar[Mapping[str, float] | None] = {"I_0": 0.0}
    needs: ClassVar[tuple[str, ...]] = ("current",)
    I_0: Scalar = parameter("A", Real(0.02), 0.0, "zero of the current sensor", "Ziegler et al. 2009")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(current=self.I_0)


# A current that is logged late
class ChannelDelay(AbstractEffect):
    """The current logged at time t is that of t - t_c: channels sampled in turn, or sent on different buses.

    Source: Kester 2005 (multiplexed acquisition). Differs from source: the delay may be longer than a sample.
    """

    name = "channel_delay"
    scope = "channel"
    told_by = "a voltage step with voltage and current on one trigger"
    off: ClassVar[Mapping[str, float] | None] = {"t_c": 0.0}
    inexact: ClassVar[float] = 0.1
    delays: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("current", "circuit")
    t_c: Scalar = parameter("s", NonNegative(0.002), 0.0, "delay of the logged current", "Kester 2005")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(current_delay=self.t_c)
