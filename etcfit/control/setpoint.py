"""Setpoints: corners joined by straight lines, and the levels on which a response is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np


@dataclass(frozen=True)
class Level:
    """A new level of the setpoint."""

    begins: float  # time at which the setpoint begins to change, s
    ends: float  # time at which it changes again, s
    # before, after: setpoint, shares of the travel
    before: float
    after: float
    scenario: str = ""  # scenario to which it belongs

    @property
    def change(self) -> float:
        """Share of the travel, either sign."""
        return self.after - self.before


class Stretch(NamedTuple):
    """Part of a setpoint over which the tracking error is computed."""

    # begins, ends: s
    begins: float
    ends: float
    scenario: str = ""  # of which it is a part


@dataclass(frozen=True)
class Setpoint:
    """A setpoint in shares of the travel."""

    times: tuple[float, ...]  # times of its corners, s, from 0
    shares: tuple[float, ...]  # its values at the corners
    levels: tuple[Level, ...]  # levels on which a response is judged
    # parts over which the tracking error is computed; empty: the whole from the first change on
    tracked: tuple[Stretch, ...] = ()

    @property
    def duration(self) -> float:
        """s."""
        return self.times[-1]

    @property
    def judged_from(self) -> float:
        """Begin of the first change, s; before it the loop settles."""
        return self.levels[0].begins

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """The parts over which the tracking error is computed."""
        return self.tracked or (Stretch(self.judged_from, self.duration, self.levels[0].scenario),)

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names, in their order."""
        parts = sorted((*self.levels, *self.stretches), key=lambda part: part.begins)
        return tuple(dict.fromkeys(part.scenario for part in parts))

    def only(self, scenario: str) -> tuple[Level, ...]:
        """Levels of a scenario."""
        return tuple(level for level in self.levels if level.scenario == scenario)

    def at(self, time: Any) -> np.ndarray:
        """Shares of the travel at these instants (s)."""
        return np.interp(time, self.times, self.shares)

    def instants(self, period: float) -> np.ndarray:
        """Ticks of a clock from 0 up to the end, s."""
        return period * np.arange(round(self.duration / period))


_HALF = 0.5  # s, of a trapezoid at 1 Hz
_EDGE = 0.1  # s; the paper does not give the duration of its edges: with this one its gains give its overshoot


def trapezoid(low: float = 0.05, high: float = 0.45, cycles: int = 1, lead: float = 0.5) -> Setpoint:
    """The paper's trapezoid, 5 to 45 % at 1 Hz (section 4.1).

    Args:
        low, high: shares of the travel.
        cycles: number of trapezoids.
        lead: time at the low level before the first, not judged, s.
    """
    times, shares, levels = [0.0], [low], []
    for k in range(2 * cycles):
        before, after = (low, high) if k % 2 == 0 else (high, low)
        begins = lead + k * _HALF
        times += [begins, begins + _EDGE]
        shares += [before, after]
        levels.append(Level(begins, begins + _HALF, before, after, "trapezoid"))
    return Setpoint((*times, levels[-1].ends), (*shares, shares[-1]), tuple(levels))


def step(low: float, high: float, hold: float, lead: float = 0.5) -> Setpoint:
    """One step from low to high after `lead` s, held for `hold` s."""
    return stairs("step", (low, high), hold, lead)


def stairs(scenario: str, shares: Sequence[float], hold: float, lead: float) -> Setpoint:
    """Steps from each share of the travel to the next, each held for `hold` s, the first for `lead` s."""
    times, corners, levels = [0.0], [shares[0]], []
    for k, (before, after) in enumerate(pairwise(shares)):
        begins = lead + k * hold
        times += [begins, begins]
        corners += [before, after]
        levels.append(Level(begins, begins + hold, before, after, scenario))
    return Setpoint((*times, levels[-1].ends), (*corners, shares[-1]), tuple(levels))


def in_turn(first: Setpoint, *others: Setpoint) -> Setpoint:
    """Setpoints one after the other; the tracking error is computed over the first, and over the `tracked` parts of the
    others."""
    times, shares, levels, tracked = list(first.times), list(first.shares), list(first.levels), list(first.stretches)
    for other in others:
        since = times[-1]
        times += [since + time for time in other.times]
        shares += other.shares
        levels += [replace(level, begins=since + level.begins, ends=since + level.ends) for level in other.levels]
        tracked += [Stretch(since + begins, since + ends, name) for begins, ends, name in other.tracked]
    return Setpoint(tuple(times), tuple(shares), tuple(levels), tuple(tracked))
