"""A trace that somebody else planned, made and logged on the independent bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .drives import Drive
from .kernel import Plant
from .protocols import GRACE, Series, Session, Trace
from .simulate import NEVER, motor_alone, resting_angle, terminals_open, throttle
from .truth import OPEN

_JUMP = 0.2  # V between two samples that are meant as a jump


@dataclass(frozen=True)
class _Bench:
    """What one rig test does to the body, and what it logs."""

    plant: Callable[[Session], Plant]
    headers: tuple[str, ...]
    held: bool = False


def _throttle(s: Session) -> Plant:
    return throttle(s.truth, s.effects)


def _behind_a_shunt(s: Session) -> Plant:
    return throttle(s.truth, s.effects, s.bench.series_ohm)


def _motor(s: Session) -> Plant:
    return motor_alone(s.truth, s.effects)


def _open(s: Session) -> Plant:
    return terminals_open(s.truth, s.effects)


_DRIVEN = ("time [s]", "voltage [V]", "current [A]")
_LET_GO = ("time [s]", "emf [V]", "tps [V]")
_BENCHES = {
    "resistance": _Bench(_throttle, _DRIVEN, held=True),
    "inductance": _Bench(_behind_a_shunt, _DRIVEN, held=True),
    "back_emf": _Bench(_open, _LET_GO),
    "inertia": _Bench(_open, _LET_GO),
    "viscous": _Bench(_motor, (*_DRIVEN, "motor_speed [rpm]")),
    "static_load": _Bench(_throttle, (*_DRIVEN, "tps [V]")),
    "response": _Bench(_throttle, (*_DRIVEN, "tps [V]")),
}


def record(session: Session, test: str, time: np.ndarray, volts: np.ndarray | None, release: float | None) -> Trace:
    """TEST/planned.csv.

    Args:
        session: the body and the instruments.
        test: the rig test.
        time: planned samples, evenly spaced from 0, s, shape (n,).
        volts: planned there, linear between but for jumps, V, shape (n,); None with open terminals.
        release: when the plate, held open, is let go, s; None where nobody holds it there.
    """
    bench = _BENCHES[test]
    plant = bench.plant(session)
    series = Series(1, float(time[-1]), 1.0 / float(time[1] - time[0]))
    rest = resting_angle(session.truth, session.effects) if release is None else OPEN
    held = NEVER if bench.held else release or 0.0
    lead = 30.0 * plant.L / plant.R if bench.held else 0.0  # a held motor's current has settled; a plate has not moved
    drive = _drive(time, np.zeros(time.size) if volts is None else volts, lead)
    columns = session.record(plant, drive, series, bench.headers, angle=rest, held_until=held)
    return Trace(f"{test}/planned.csv", columns)


def _drive(time: np.ndarray, volts: np.ndarray, lead: float) -> Drive:
    """Its first voltage is on since `lead` s."""
    edges = np.flatnonzero(np.abs(np.diff(volts)) > _JUMP) + 1
    knots, levels = np.insert(time, edges, time[edges]), np.insert(volts, edges, volts[edges - 1])
    return Drive(np.concatenate(([-lead], knots, [time[-1] + GRACE])), np.concatenate((volts[:1], levels, levels[-1:])))
