"""Which log to record next: the setpoint moves that a search for gains needs, and those that the logs lack.

`WANTED` lists them, the most useful first; another kind of move is one more line there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .log import DriveLog
from .steps import pairs_with_quick_change, rests

_SETTLES = 0.5  # s of a rest in which the plate may still move
_STILL = "the target still for 0.5 s before and after"
_DEFAULT = 3.0, 20.0  # per cent: between which a limp-home position lies


@dataclass(frozen=True)
class Moves:
    """The setpoint moves in some logs."""

    steps: np.ndarray  # setpoint before and after each quick change between two rests, per cent, shape (n, 2)
    rests: np.ndarray  # duration of each rest, s
    reach: tuple[float, float] | None  # least and largest setpoint, per cent; None where no log has a setpoint

    def between(self, low: float, high: float, sign: int) -> int:
        """Number of steps in one direction whose size lies between two limits, per cent."""
        change = sign * (self.steps[:, 1] - self.steps[:, 0])
        return int(np.sum((change >= low) & (change < high)))


@dataclass(frozen=True)
class Wanted:
    """One kind of move that the logs should hold."""

    name: str  # in words
    record: str  # what to do
    why: str  # what it determines
    needed: float  # required amount, in the unit of `there`
    there: Callable[[Moves], float]  # the amount in some moves
    unit: str


@dataclass(frozen=True)
class Lack:
    """A log to record next."""

    name: str  # of the missing moves
    # found, needed: amount of them
    found: float
    needed: float
    unit: str  # of both
    record: str  # what to do
    why: str  # what it determines


def _both_ways(low: float, high: float) -> Callable[[Moves], float]:
    return lambda moves: min(moves.between(low, high, 1), moves.between(low, high, -1))


def _across(moves: Moves) -> float:
    """Number of steps across the range in which a plate may rest, in the direction that has fewer."""
    low, high = moves.steps.min(axis=1), moves.steps.max(axis=1)
    over = (low <= _DEFAULT[0]) & (high >= _DEFAULT[1])
    rises = moves.steps[:, 1] > moves.steps[:, 0]
    return float(min(np.sum(over & rises), np.sum(over & ~rises)))


def _at_rest(moves: Moves) -> float:
    return float(np.sum(np.maximum(moves.rests - _SETTLES, 0.0)))


def _reach(moves: Moves) -> float:
    return 0.0 if moves.reach is None else moves.reach[1] - moves.reach[0]


WANTED = (
    Wanted("hold at rest", "hold the pedal still at three openings, 5 s each, engine off",
           "noise of the sensor, and variation of the duty at rest", 10.0, _at_rest, "s at rest"),
    Wanted("small steps", f"steps of 0.5 to 3 % and back, {_STILL} (the ECU's bench test)",
           "dry friction: overshoot and settling are worst there", 4, _both_ways(0.3, 3.5), "each way"),
    Wanted("large steps", f"steps of 30 % and more and back, {_STILL}",
           "limits of duty and speed, winding-up of the integral", 2, _both_ways(30.0, 101.0), "each way"),
    Wanted("across the limp-home position", f"steps from 2 % to 25 % and back, {_STILL}",
           "the other spring and the preloads: the duty changes its sign there", 2, _across, "each way"),
    Wanted("the whole travel", "one slow ramp from closed to open and back, 5 s each way, engine off",
           "springs and bias curve over the positions visited", 80.0, _reach, "% of travel, by the target"),
)  # fmt: skip
SUPPLY = Lack(
    "supply", 0.0, 2.0, "V between logs", "engine off, one log with the lights on and one on a battery charger",
    "how every gain changes with the supply voltage: a duty is a share of it, position and setpoint are not",
)  # fmt: skip
"""Always requested, because `etcfit drive` reads no supply."""


def moves_of(logs: Sequence[DriveLog]) -> Moves:
    """The setpoint moves of these logs together; a log without a setpoint adds none."""
    pieces = [piece for log in logs if log.setpoint is not None for piece in log.setpoint.pieces]
    found = [rests(piece) for piece in pieces if piece.time.size > 1]
    steps = [(before.last, after.first) for each in found for before, after in pairs_with_quick_change(each)]
    lasted = np.array([rest.end - rest.begin for each in found for rest in each])
    values = [piece.value for piece in pieces]
    reach = (min(float(v.min()) for v in values), max(float(v.max()) for v in values)) if values else None
    return Moves(np.array(steps).reshape(-1, 2), lasted, reach)


def record_next(logs: Sequence[DriveLog]) -> tuple[Lack, ...]:
    """What these logs lack, the most useful first."""
    moves = moves_of(logs)
    held = [(each, each.there(moves)) for each in WANTED]
    lacks = [Lack(w.name, there, w.needed, w.unit, w.record, w.why) for w, there in held if there < w.needed]
    return (*lacks, SUPPLY)
