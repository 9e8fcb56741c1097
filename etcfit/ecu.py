"""What an engine computer is, its gains apart: the one that drove the logs, and the one that gains are sought for."""

from __future__ import annotations

from typing import NamedTuple


class Ecu(NamedTuple):
    """A controller's own limits; data to compiled functions, so that another one compiles nothing.

    Args:
        period: of its clock, s.
        supply: its output stays within -supply and supply, V.
        filter: time constant of the derivative's low-pass, s; 0 for none.
        delay: from a tick, where it reads, to where its output acts, s.
        pwm: resolution of the output, V; 0 for none.
        resolution: of the position it reads, rad; 0 for none.
    """

    period: float = 1e-3
    supply: float = 12.0
    filter: float = 2e-3
    delay: float = 0.0
    pwm: float = 0.0
    resolution: float = 0.0

    @property
    def late(self) -> float:
        """By how much the output lags what was read, s: its hold lasts half a period on average."""
        return self.delay + 0.5 * self.period

    @property
    def constants(self) -> dict[str, float]:
        """Parameters of `effects.controller`, never fitted, SI by symbol; the steps of its converters are not in it."""
        return {"t_e": self.period, "tau_e": self.filter, "t_l": self.delay, "V_e": self.supply}
