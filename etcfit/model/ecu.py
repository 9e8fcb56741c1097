"""What an engine computer is, its gains apart: the one that drove the logs, and the one that gains are sought for; and
how such a computer writes its gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .parameters import Scalar


class Ecu(NamedTuple):
    """What limits a discrete controller, its gains apart. An argument of compiled programs: another one compiles
    nothing.

    Args:
        period: of its clock, s.
        supply: V at a duty of 100 %; what the PID asks for stays within it.
        filter: time constant of the derivative's low-pass, s; 0 for none.
        delay: from a tick, where it reads, to where its output acts, s.
        pwm: resolution of the output, V; 0 for none.
        resolution: of the position it reads, rad; 0 for none.
        duty: largest that it puts out, a share of the supply.
        integral: largest that its integral may hold, a share of the supply, running on while the output is at its
            limit; 0 for none, and then it stands still there.
        noise: of the position it reads, one tick's from the next one's independent, rad, a standard deviation.
        lag: time constant of the filter ahead of its converter, s; 0 for none.
        slew: largest change of its output, V/s; 0 for none. The integral stands still there too.
        dead_band: error below which the integral stands still, rad; 0 for none.
        setpoint_weight: b of Kp (b r - y), 1 where the proportional part acts on the error, 0 on the position alone.
        derivative_weight: c of Kd d(c r - y)/dt, 1 where the derivative is the error's, 0 the position's alone.
        compensated: 1 where it divides its output by the battery voltage, so that the output means volts; 0 where the
            output is a duty of whatever supply there is.
    """

    period: float = 1e-3
    supply: float = 12.0
    filter: float = 2e-3
    delay: float = 0.0
    pwm: float = 0.0
    resolution: float = 0.0
    duty: float = 1.0
    integral: float = 0.0
    noise: float = 0.0
    lag: float = 0.0
    slew: float = 0.0
    dead_band: float = 0.0
    setpoint_weight: float = 1.0
    derivative_weight: float = 1.0
    compensated: float = 0.0

    @property
    def limit(self) -> Scalar:
        """Its output stays within this and its negative, V."""
        return self.duty * self.supply

    @property
    def late(self) -> float:
        """By how much its output lags the plate, s: filter, delay, and a hold of half a period on average."""
        return self.lag + self.delay + 0.5 * self.period

    @property
    def derivative_late(self) -> float:
        """By how much its derivative lags that of the error, s: its filter, and half a period of the difference."""
        return self.filter + 0.5 * self.period

    @property
    def constants(self) -> dict[str, float]:
        """Its limits as parameters of `effects.controller`, SI by symbol; those of its converters are not modelled
        there."""
        return {"t_e": self.period, "tau_e": self.filter, "t_l": self.delay, "V_e": self.limit,
                "d_e": self.duty, "I_e": self.integral, "S_e": self.slew / self.supply, "e_0": self.dead_band,
                "b": self.setpoint_weight, "c": self.derivative_weight}  # fmt: skip


BiasPoints = tuple[tuple[float, float], ...]
"""Feed-forward of an ECU, linear between points and constant beyond: setpoint and output."""

OUTPUTS, ERRORS, FORMS = ("V", "%"), ("rad", "deg", "%"), ("seconds", "ticks")


class Terms(NamedTuple):
    """The three gains of an ECU in its own units, or one unit of each in SI: V/rad, V/(rad s), V s/rad."""

    P: Scalar
    I: Scalar  # noqa: E741  (the ECUs' own name)
    D: Scalar


@dataclass(frozen=True)
class Notation:
    """How an ECU writes its gains.

        Kp = P u/e,   Ki = I u/(e t),   Kd = D u t/e

    u is one unit of its output in V, e one of its error in rad, t its period where it counts ticks, else 1 s.

    Args:
        output: "V", or "%" of duty.
        error: "rad", "deg", or "%" of the travel.
        form: "ticks" (I per tick and D in ticks) or "seconds".
    """

    output: str = "V"
    error: str = "rad"
    form: str = "seconds"

    @property
    def unit(self) -> str:
        """As rig.toml has it: "%/%"."""
        return f"{self.output}/{self.error}"

    @property
    def title(self) -> str:
        """Unit and form: "%/%, ticks"."""
        return f"{self.unit}, {self.form}"

    @property
    def of_each(self) -> tuple[str, str, str]:
        """Unit of each gain in words: "%/%", "%/%, per s" and "%/%, times s"."""
        per, times = {"seconds": ("per s", "times s"), "ticks": ("per tick", "times ticks")}[self.form]
        return self.unit, f"{self.unit}, {per}", f"{self.unit}, {times}"

    def units(self, ecu: Ecu, travel: float) -> Terms:
        """One unit of each gain in SI.

        Args:
            ecu: its period and supply.
            travel: of the plate, rad.
        """
        volts = {"V": 1.0, "%": ecu.supply / 100.0}[self.output]
        angle = {"rad": 1.0, "deg": math.pi / 180.0, "%": travel / 100.0}[self.error]
        tick = {"seconds": 1.0, "ticks": ecu.period}[self.form]
        return Terms(volts / angle, volts / angle / tick, volts / angle * tick)

    def written(self, gains: tuple[Scalar, Scalar, Scalar], ecu: Ecu, travel: float) -> Terms:
        """Gains as this ECU writes them.

        Args:
            gains: Kp (V/rad), Ki (V/(rad s)) and Kd (V s/rad).
            ecu: its period and supply.
            travel: of the plate, rad.
        """
        return Terms(*(gain / unit for gain, unit in zip(gains, self.units(ecu, travel), strict=True)))
