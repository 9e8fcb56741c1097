"""A table of gains over the supply: what it holds, what it is worth, and whether one over the position would be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..model.ecu import Ecu, Notation, Terms
from .judged import over_models
from .pid import Gains, LoopFigures, Task
from .pid.conditions import at_corners, corners
from .pid.linear_loop import FINE, OpenLoop, controller
from .pid.loop import Loop

_PLACES = 201  # evenly over the travel, at which the plant's gain is compared
NEAR = 0.1  # by how much that may differ from the gain at a quarter of the travel where a table is still worth nothing


class AtSupply(NamedTuple):
    """Gains at one supply, at the corners of winding and friction, each figure at its worst."""

    supply: float  # V
    fixed: LoopFigures  # with the gains as typed in for the ECU's own supply
    table: LoopFigures  # with those of the table

    @property
    def helps(self) -> bool:
        """Whether the table follows more closely."""
        return bool(self.table.rmse_pct < self.fixed.rmse_pct)


class OverPosition(NamedTuple):
    """How the plant's gain at the loop's crossover differs over the travel."""

    frequency: float  # of the crossover at a quarter of the travel, Hz; the highest where there are several
    shares: np.ndarray  # of the travel at which it is compared, shape (P,)
    ratio: np.ndarray  # of the gain there to that at a quarter of the travel, shape (P,)

    @property
    def alike(self) -> float:
        """Share of the places at which it hardly differs."""
        return float(np.mean(np.abs(self.ratio - 1.0) <= NEAR))


@dataclass(frozen=True, eq=False)
class SupplyTable:
    """P, I and D over the supply such that the loop stays the one that was designed.

        P(U) = P(U_0) U_0 / U,    I and D likewise

    An ECU that puts out a duty drives the motor with duty U: its gains in % mean volts in proportion to the supply.
    Divided by it they mean the same volts, and the loop around the linear plant is the same but for the duty's limit,
    which still is one in %. Gains in V, or of an ECU that divides by the battery voltage, are none of the supply's
    business: their table is flat. Between its points, 1 V apart, a table that is straight is off by less than
    1 V^2 / (4 U^2), 0.3 % at 9 V.
    """

    supplies: tuple[float, ...]  # at its points, V, rising
    ends: tuple[AtSupply, ...]  # what it is worth at the least and at the largest supply of a car
    position: OverPosition  # why there is no table over the position

    def written(self, gains: Gains, notation: Notation, ecu: Ecu, travel: float) -> tuple[Terms, ...]:
        """The three gains, of the ECU's own supply, as it writes them at each of these; travel of the plate in rad."""
        supplies = (ecu.supply if ecu.compensated else supply for supply in self.supplies)
        return tuple(notation.written(gains, ecu._replace(supply=supply), travel) for supply in supplies)


def supply_table(task: Task, gains: Gains) -> SupplyTable:
    """The table of some gains, tried at both ends of the supply beside the gains without a table."""
    ranges = task.settings.conditions
    fixed = at_corners(task.loop, ranges)
    ends = []
    for supply in dict.fromkeys(ranges.supply):
        # an ECU that divides by the battery voltage needs no table
        knowing = fixed
        if not task.ecu.compensated:
            knowing = at_corners(task.loop.under(reckoning_with(task.ecu, supply)), ranges)
        ends.append(AtSupply(supply, *(_worst(task, loop, gains, supply) for loop in (fixed, knowing))))
    return SupplyTable(task.settings.schedule.supplies, tuple(ends), over_position(task, gains))


def reckoning_with(ecu: Ecu, supply: float) -> Ecu:
    """The ECU as it is where it reckons with another supply (V): what it has in % of duty means other volts."""
    more = supply / ecu.supply
    return ecu._replace(supply=supply, pwm=more * ecu.pwm, slew=more * ecu.slew)


def _worst(task: Task, loop: Loop, gains: Gains, supply: float) -> LoopFigures:
    """Each figure at its worst of the corners that have this supply (V)."""
    there = corners(task.settings.conditions).supply == supply
    found = over_models(task, loop, Gains.stacked(gains)).of_rule(0)
    return found.figures.worst(there)


def over_position(task: Task, gains: Gains) -> OverPosition:
    """The nominal plant's gain at the crossover, linearised at places over the travel."""
    ecu, loop = task.ecu, task.loop.first(1)
    frequencies = FINE.frequencies(ecu.period)
    open_loop = OpenLoop.of_plants(task.plant, ecu)
    around = np.abs(controller(gains, ecu, open_loop.z) * open_loop.response)
    crossover = float(frequencies[np.max(np.flatnonzero(around >= 1.0), initial=0)])
    shares = (np.arange(_PLACES) + 0.5) / _PLACES
    there = np.array([abs(loop.linear(share)(1j * crossover)).item() for share in shares])
    here = abs(task.plant(1j * crossover))
    return OverPosition(crossover / (2.0 * np.pi), shares, there / here)
