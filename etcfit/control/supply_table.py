"""A table of gains over the supply and its benefit, and whether a table over the position would have one."""

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

_PLACES = 201  # number of places, evenly over the travel, at which the plant's gain is compared
NEAR = 0.1  # relative difference from the gain at a quarter of the travel up to which a table has no benefit


class AtSupply(NamedTuple):
    """Figures of gains at one supply, each at its worst over the corners of winding and friction."""

    supply: float  # V
    fixed: LoopFigures  # with constant gains, those for the nominal supply of the ECU
    table: LoopFigures  # with the gains of the table

    @property
    def helps(self) -> bool:
        """Whether the table has the smaller tracking error."""
        return bool(self.table.rmse_pct < self.fixed.rmse_pct)


class OverPosition(NamedTuple):
    """The plant's gain at the loop's crossover over the travel."""

    frequency: float  # crossover frequency at a quarter of the travel, Hz; the highest where there are several
    shares: np.ndarray  # places at which it is compared, shares of the travel, shape (P,)
    ratio: np.ndarray  # gain there over that at a quarter of the travel, shape (P,)

    @property
    def alike(self) -> float:
        """Share of the places at which it hardly differs."""
        return float(np.mean(np.abs(self.ratio - 1.0) <= NEAR))


@dataclass(frozen=True, eq=False)
class SupplyTable:
    """P, I and D over the supply with which the loop stays as designed.

        P(U) = P(U_0) U_0 / U,    I and D likewise

    An ECU that puts out a duty drives the motor with duty U: the voltage of its gains in % is proportional to the
    supply. Divided by the supply they give the same voltage, and the loop with the linear plant is the same except for
    the limit of the duty, which remains a limit in %. Gains in V, or of an ECU that divides by the battery voltage, do
    not depend on the supply: their table is flat. Between its points, 1 V apart, the error of a linear table is less
    than 1 V^2 / (4 U^2), 0.3 % at 9 V.
    """

    supplies: tuple[float, ...]  # at its points, V, rising
    ends: tuple[AtSupply, ...]  # figures at the least and at the largest supply of a car
    position: OverPosition  # gain over the position, which shows whether a table over the position would help

    def written(self, gains: Gains, notation: Notation, ecu: Ecu, travel: float) -> tuple[Terms, ...]:
        """The three gains in the ECU's notation at each supply, from those at its nominal supply; travel in rad."""
        supplies = (ecu.supply if ecu.compensated else supply for supply in self.supplies)
        return tuple(notation.written(gains, ecu._replace(supply=supply), travel) for supply in supplies)


def supply_table(task: Task, gains: Gains) -> SupplyTable:
    """The table of some gains, compared with the constant gains at both ends of the supply."""
    ranges = task.settings.conditions
    fixed = at_corners(task.loop, ranges)
    ends = []
    for supply in dict.fromkeys(ranges.supply):
        # an ECU that divides by the battery voltage needs no table
        knowing = fixed
        if not task.ecu.compensated:
            knowing = at_corners(task.loop.under(ecu_for_supply(task.ecu, supply)), ranges)
        ends.append(AtSupply(supply, *(_worst(task, loop, gains, supply) for loop in (fixed, knowing))))
    return SupplyTable(task.settings.schedule.supplies, tuple(ends), over_position(task, gains))


def ecu_for_supply(ecu: Ecu, supply: float) -> Ecu:
    """The ECU with another nominal supply (V): its limits in % of duty are other voltages."""
    more = supply / ecu.supply
    return ecu._replace(supply=supply, pwm=more * ecu.pwm, slew=more * ecu.slew)


def _worst(task: Task, loop: Loop, gains: Gains, supply: float) -> LoopFigures:
    """Each figure at its worst over the corners that have this supply (V)."""
    there = corners(task.settings.conditions).supply == supply
    return over_models(task, loop, Gains.stacked(gains)).of_gains(0).worst(there)


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
