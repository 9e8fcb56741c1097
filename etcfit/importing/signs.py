"""Which columns are turned round: current against voltage, EMF, speed and angle against what moves them.

i v >= 0 on average                  a motor takes power
e < 0 while a released plate closes  e = K_b N d theta/dt
w v > 0                              a motor alone runs the way it is driven
theta rises with voltage             positive voltage opens
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from . import shapes
from .record import Record, let_go
from .settings import GuessSettings


@dataclass(frozen=True)
class Vote:
    """What one record says of one quantity.

    Args:
        quantity: of the column.
        label: of the column; its other records are turned with it.
        strength: -1, turned round for sure, to 1, right for sure.
        why: what it would mean.
    """

    quantity: str
    label: str
    strength: float
    why: str


def turned(records: Sequence[Record], settings: GuessSettings) -> list[Record]:
    """The records, columns that run the wrong way with -1 before their unit."""
    records = _turned_by(records, _of_voltage, settings)
    for votes in (_of_current, _of_speed, _of_emf, _of_position):
        records = _turned_by(records, votes, settings)
    return list(records)


def _turned_by(
    records: Sequence[Record], vote_of: Callable[[Record, GuessSettings], Vote | None], settings: GuessSettings
) -> list[Record]:
    votes = [vote_of(record, settings) for record in records]
    return [_turn(record, votes, own, settings) for record, own in zip(records, votes, strict=True)]


def _turn(record: Record, votes: Sequence[Vote | None], own: Vote | None, settings: GuessSettings) -> Record:
    """By its own vote where that is clear, else by the clearest of the same column elsewhere.

    A plate that is driven fast runs behind its voltage: its own record says little where a slow one is at hand.
    """
    same = [v for v in votes if v is not None and abs(v.strength) > settings.turns]
    if own is None or abs(own.strength) <= settings.turns or own.quantity == "position":
        labels = {(take.quantity, take.column.label) for take in record.takes}
        heard = [v for v in same if (v.quantity, v.label) in labels]
        own = max(heard, key=lambda v: abs(v.strength), default=None)
    if own is None or own.strength >= 0.0:
        return record
    take = record.take(own.quantity)
    if take is None or take.said:
        return record
    against = any(
        v.strength > settings.surely_turns for v in same if (v.quantity, v.label) == (own.quantity, own.label)
    )
    return record.with_take(take.turned(own.why, own.strength < -settings.surely_turns and not against))


def _vote(record: Record, quantity: str, strength: float, why: str) -> Vote | None:
    take = record.take(quantity)
    return None if take is None else Vote(quantity, take.column.label, strength, why)


def _of_current(record: Record, settings: GuessSettings) -> Vote | None:
    signals = record.signals
    drive = signals.get("voltage", signals.get("duty"))
    if "current" not in signals or drive is None:
        return None
    samples = max(1, drive.size // 200)
    strength = shapes.along(shapes.smooth(drive, samples), shapes.smooth(signals["current"], samples))
    return _vote(record, "current", strength, "it runs against the voltage")


def _of_speed(record: Record, settings: GuessSettings) -> Vote | None:
    signals = record.signals
    if "motor_speed" not in signals or "voltage" not in signals:
        return None
    strength = shapes.along(signals["voltage"], signals["motor_speed"])
    return _vote(record, "motor_speed", strength, "the motor runs against its voltage")


def _of_emf(record: Record, settings: GuessSettings) -> Vote | None:
    """A released plate closes, so its EMF is negative."""
    signals = record.signals
    plate = record.plate(signals)
    name = "emf" if "emf" in signals else "voltage"
    if plate is None or name not in signals or not let_go(record, settings):
        return None
    pace = np.abs(shapes.slope(plate, record.time))
    fast = pace > 0.3 * np.max(pace)
    size = float(np.sum(np.abs(signals[name][fast])))
    strength = -float(np.sum(signals[name][fast])) / size if size > 0.0 else 0.0
    return _vote(record, name, strength, "it is positive while the released plate closes")


def _of_voltage(record: Record, settings: GuessSettings) -> Vote | None:
    """Driven open by negative volts: leads exchanged."""
    signals = record.signals
    plate, voltage = record.plate(signals), signals.get("voltage")
    if plate is None or voltage is None or let_go(record, settings) or "position" not in signals:
        return None
    lean = float(np.sum(voltage)) / max(float(np.sum(np.abs(voltage))), 1e-300)
    opens = opening(record, settings)
    if lean > -settings.exchanged or opens > -settings.turns:
        return None
    return _vote(record, "voltage", opens, "negative volts open the plate")


def _of_position(record: Record, settings: GuessSettings) -> Vote | None:
    if record.take("position") is None:
        return None
    return _vote(record, "position", opening(record, settings), "it falls while the plate opens")


def opening(record: Record, settings: GuessSettings) -> float:
    """How clearly a rising reading means an opening plate, -1 to 1: with the drive, or from the fall of a release."""
    signals = record.signals
    plate, drive = record.plate(signals), record.drive(signals)
    if plate is None:
        return 0.0
    if let_go(record, settings):
        ends = max(1, plate.size // 50)
        size = max(shapes.span(plate), 1e-300)
        return float(np.clip((np.mean(plate[:ends]) - np.mean(plate[-ends:])) / size, -1.0, 1.0))
    if "setpoint" in signals:
        return 0.0
    if drive is None:
        return 0.0
    samples = max(3, plate.size // 50)
    return shapes.correlation(shapes.smooth(drive, samples), shapes.smooth(plate, samples))
