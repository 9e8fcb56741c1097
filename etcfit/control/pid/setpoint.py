"""Setpoints: corners joined by straight lines, and the levels on which a response is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Level:
    """A new level of the setpoint.

    Args:
        begins: where the setpoint begins to change, s.
        ends: where it changes again, s.
        before, after: shares of the travel.
    """

    begins: float
    ends: float
    before: float
    after: float


@dataclass(frozen=True)
class Setpoint:
    """A setpoint in shares of the travel.

    Args:
        times: of its corners, s, from 0.
        shares: at its corners.
        levels: on which it is judged.
    """

    times: tuple[float, ...]
    shares: tuple[float, ...]
    levels: tuple[Level, ...]

    @property
    def duration(self) -> float:
        """s."""
        return self.times[-1]

    @property
    def judged_from(self) -> float:
        """Where the first change begins, s; before it the loop finds its rest."""
        return self.levels[0].begins

    def at(self, time: Any) -> np.ndarray:
        """Shares of the travel at these instants (s)."""
        return np.interp(time, self.times, self.shares)

    def instants(self, period: float) -> np.ndarray:
        """Ticks of a clock from 0 up to the end, s."""
        return period * np.arange(round(self.duration / period))


def trapezoid(low: float = 0.05, high: float = 0.45, hertz: float = 1.0, edge: float = 0.1, cycles: int = 1,
              lead: float = 0.5) -> Setpoint:  # fmt: skip
    """The paper's trapezoid, 5 to 45 % at 1 Hz (section 4.1).

    The paper does not print its edges; with 0.1 s its own gains give its own overshoot.

    Args:
        low, high: shares of the travel.
        hertz: trapezoids in a second.
        edge: duration of an edge, s.
        cycles: how many.
        lead: s at the low level before the first, not judged.
    """
    half = 0.5 / hertz
    times, shares, levels = [0.0], [low], []
    for k in range(2 * cycles):
        before, after = (low, high) if k % 2 == 0 else (high, low)
        begins = lead + k * half
        times += [begins, begins + edge]
        shares += [before, after]
        levels.append(Level(begins, begins + half, before, after))
    return Setpoint((*times, levels[-1].ends), (*shares, shares[-1]), tuple(levels))


def step(low: float, high: float, hold: float, lead: float = 0.5) -> Setpoint:
    """One step from low to high after `lead` s, held for `hold` s."""
    end = lead + hold
    return Setpoint((0.0, lead, lead, end), (low, low, high, high), (Level(lead, end, low, high),))
