"""A driver's bridge fed by a supply that sags: a duty in, the terminal voltage out."""

from __future__ import annotations

import numpy as np

from .drives import Drive
from .kernel import Plant
from .simulate import simulate

WRITTEN = 1e-5  # of the logged duty
WITHIN = 10  # knots between two ticks
ROUNDS = 12  # of the fixed point below; each takes what is wrong down by about R_s/R


def duty_of(drive: Drive, rate: float, count: int, supply: float) -> np.ndarray:
    """What an output register holds from each of so many ticks to the next, -1 to 1."""
    wanted = drive.at(np.arange(count) / rate) / supply
    return WRITTEN * np.round(np.clip(wanted, -1.0, 1.0) / WRITTEN)


def fed(plant: Plant, duty: np.ndarray, rate: float, supply: float, ohm: float, angle: float) -> Drive:
    """v = d (V - R_s d i) at the motor, the current i being what flows under that v: found by going round.

    Args:
        plant: what is driven.
        duty: held from each tick to the next.
        rate: of the ticks, Hz.
        supply: its voltage without a load, V.
        ohm: R_s of supply and leads.
        angle: at which the plate rests before, rad.
    """
    shares = np.linspace(0.0, 1.0, WITHIN + 1)
    knots = (np.arange(duty.size)[:, None] + shares) / rate  # the end of a tick and the begin of the next are one time
    held = np.repeat(duty, WITHIN + 1)
    instants = np.append(knots[:, :-1].ravel(), knots[-1, -1])
    drive = Drive(knots.ravel(), held * supply)
    for _ in range(ROUNDS if ohm > 0.0 else 0):
        current = np.interp(knots.ravel(), instants, simulate(plant, drive, instants, angle=angle).current)
        drive = Drive(knots.ravel(), held * (supply - ohm * held * current))
    return drive
