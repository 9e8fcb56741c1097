"""Properties of an engine computer without its gains, for the one that drove the logs and the one to be tuned; and how
such a computer writes its gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .parameters import Scalar


class Ecu(NamedTuple):
    """Limits and times of a discrete controller, without its gains. It is an argument of compiled programs: another ECU
    needs no compilation.
    """

    period: float = 1e-3  # period of its clock, s
    supply: float = 12.0  # voltage at a duty of 100 %, V; the limit of the PID's output
    filter: float = 2e-3  # time constant of the derivative's low-pass, s; 0 for none
    delay: float = 0.0  # delay from a tick, when it reads, to the action of its output, s
    pwm: float = 0.0  # resolution of the output, V; 0 for none
    resolution: float = 0.0  # resolution of the position that it reads, rad; 0 for none
    duty: float = 1.0  # largest duty of its output, a share of the supply
    # limit of its integral, a share of the supply; the integral continues while the output is at its limit. 0: no
    # limit, and the integral is held there.
    integral: float = 0.0
    noise: float = 0.0  # standard deviation of the position that it reads, independent from tick to tick, rad
    lag: float = 0.0  # time constant of the filter in front of its converter, s; 0 for none
    slew: float = 0.0  # largest change of its output, V/s; 0 for none. The integral is held there too.
    dead_band: float = 0.0  # error below which the integral is held, rad; 0 for none
    # weight b of Kp (b r - y): 1 if the proportional part acts on the error, 0 if on the position alone
    setpoint_weight: float = 1.0
    # weight c of Kd d(c r - y)/dt: 1 if the derivative is that of the error, 0 that of the position alone
    derivative_weight: float = 1.0
    # 1 if it divides its output by the battery voltage, so that the output means volts; 0 if the output is a duty of
    # the present supply
    compensated: float = 0.0

    @property
    def limit(self) -> Scalar:
        """Largest absolute value of its output, V."""
        return self.duty * self.supply

    @property
    def late(self) -> float:
        """Delay of its output after the plate, s: filter, delay, and a hold of half a period on average."""
        return self.lag + self.delay + 0.5 * self.period

    @property
    def derivative_late(self) -> float:
        """Delay of its derivative after that of the error, s: its filter, and half a period of the difference."""
        return self.filter + 0.5 * self.period

    @property
    def constants(self) -> dict[str, float]:
        """Its limits as parameters of `effects.controller`, SI by symbol; its converters are not modelled there."""
        return {"t_e": self.period, "tau_e": self.filter, "t_l": self.delay, "V_e": self.limit,
                "d_e": self.duty, "I_e": self.integral, "S_e": self.slew / self.supply, "e_0": self.dead_band,
                "b": self.setpoint_weight, "c": self.derivative_weight}  # fmt: skip


BiasPoints = tuple[tuple[float, float], ...]
"""Feed-forward of an ECU, linear between points and constant beyond: setpoint and output."""

OUTPUTS, ERRORS, FORMS = ("V", "%"), ("rad", "deg", "%"), ("seconds", "ticks")


class Terms(NamedTuple):
    """The three gains of an ECU in its own units, or one unit of each in SI: V/rad, V/(rad s), V s/rad."""

    P: Scalar  # proportional
    # integral
    I: Scalar  # noqa: E741  (the ECUs' own name)
    D: Scalar  # derivative


@dataclass(frozen=True)
class Notation:
    """How an ECU writes its gains.

        Kp = P u/e,   Ki = I u/(e t),   Kd = D u t/e

    u is one unit of its output in V, e one of its error in rad, t its period if it counts ticks, else 1 s.
    """

    output: str = "V"  # unit of the output: "V", or "%" of duty
    error: str = "rad"  # unit of the error: "rad", "deg", or "%" of the travel
    form: str = "seconds"  # "ticks" (I per tick and D in ticks) or "seconds"

    @property
    def unit(self) -> str:
        """The unit as in rig.toml: "%/%"."""
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
            travel: travel of the plate, rad.
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
            travel: travel of the plate, rad.
        """
        return Terms(*(gain / unit for gain, unit in zip(gains, self.units(ecu, travel), strict=True)))
