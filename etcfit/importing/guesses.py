"""Guesses from records: columns with a wrong sign, the rig test of each record, and values for rig.toml.

i v >= 0 on average                  a motor takes power
e < 0 while a released plate closes  e = K_b N d theta/dt
w v > 0                              a motor alone runs in the direction of its voltage
theta rises with voltage             positive voltage opens
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..rig.base import RigConfig
from ..rig.units import is_percent
from . import shapes
from .record import ONE_LEVEL, RELEASE_S, Record, drive_of, is_release, plate_of

_TURNS, _SURELY_TURNS = 0.3, 0.6  # strength of a vote, 0 to 1, above which a sign is turned, and is certain
_EXCHANGED = 0.8  # share of a drive that must be negative for its leads to count as exchanged
_RESOLVED = 3  # least number of samples on a rise to determine its time constant
_BENCH_S = 60.0  # longest setpoint on a bench; a longer one is from a drive in the car
_HELD = 0.9  # share of the current's variance that v/R explains if the plate is held
_RAMP_S = 1.0  # least duration of a slow ramp in each direction
_USUAL_DEG, _BEYOND_DEG = (0.0, 90.0), 4.0  # usual travel, and largest excess of a reading within this travel
_END_QUANTILE = 0.001  # quantile of the readings that counts as an end stop
_CHARGED_V, _BENCH_V = 13.8, 12.0  # voltage of a charged battery in a car, and of a bench's supply
# tests between which only the operator or a name can decide
_FAMILIES = (
    {"resistance", "inductance"},
    {"back_emf", "inertia"},
    {"static_load", "response"},
    {"closed_loop", "sine", "drive"},
)
_NAMES = (
    ("resistance", r"resist|widerstand|ohm|(^|_)r_?a?(_|$)"),
    ("inductance", r"induct|indukt|(^|_)l_?a?(_|$)"),
    ("back_emf", r"emf|emk|generator"),
    ("static_load", r"static|statisch|ramp|rampe|hyster|load"),
    ("viscous", r"viscous|viskos|no_?load|leerlauf|motor_?alone"),
    ("inertia", r"inert|traeg|träg|release|drop|snap"),
    ("closed_loop", r"closed_?loop|regel|follow"),
    ("sine", r"(^|_)sine?(_|\d|$)|sinus"),
    ("drive", r"(^|_)(drive|car|road|trip|fahrt)(_|\d|$)"),
    ("response", r"respon|chirp|sweep|multisine|prbs|step|sprung"),
)


class Vote(NamedTuple):
    """The vote of one record on the sign of one quantity."""

    label: str  # label of the column; it is turned in all records
    strength: float  # from -1, certainly wrong, to 1, certainly right


def turned(records: Sequence[Record]) -> list[Record]:
    """The records, with -1 before the unit of columns with a wrong sign."""
    for quantity, strength_of, why in _VOTES:
        votes = []
        for record in records:
            take = record.take(quantity)
            strength = None if take is None else strength_of(record)
            votes.append(None if take is None or strength is None else Vote(take.column.label, strength))
        records = [_turn(each, quantity, why, votes, own) for each, own in zip(records, votes, strict=True)]
    return list(records)


def _turn(record: Record, quantity: str, why: str, votes: Sequence[Vote | None], own: Vote | None) -> Record:
    """Turn by its own vote if that is clear, else by the clearest vote of the same column in other records.

    A plate that is driven fast lags its voltage: its own record is a weak vote if there is a slow one.
    """
    take = record.take(quantity)
    if take is None or take.said:
        return record
    same = [v.strength for v in votes if v is not None and abs(v.strength) > _TURNS and v.label == take.column.label]
    if own is None or abs(own.strength) <= _TURNS or quantity == "position":
        strength = max(same, key=abs, default=0.0)
    else:
        strength = own.strength
    if strength >= 0.0:
        return record
    return record.with_take(take.turned(why, strength < -_SURELY_TURNS and max(same) <= _SURELY_TURNS))


def _leads(record: Record) -> float | None:
    """Vote on exchanged leads: negative volts open the plate."""
    signals = record.signals
    if "position" not in signals or is_release(record):
        return None
    voltage = signals["voltage"]
    lean = float(np.sum(voltage)) / max(float(np.sum(np.abs(voltage))), 1e-300)
    opens = opening(record)
    return None if lean > -_EXCHANGED or opens > -_TURNS else opens


def _power(record: Record) -> float | None:
    signals = record.signals
    drive = drive_of(signals, ("voltage", "duty"))
    if drive is None:
        return None
    samples = max(1, drive.size // 200)
    return shapes.along(shapes.smooth(drive, samples), shapes.smooth(signals["current"], samples))


def _speed(record: Record) -> float | None:
    signals = record.signals
    return shapes.along(signals["voltage"], signals["motor_speed"]) if "voltage" in signals else None


def _emf(record: Record, name: str = "emf") -> float | None:
    """Vote on the EMF: a released plate closes, so its EMF is negative."""
    signals = record.signals
    plate = plate_of(signals)
    if plate is None or not is_release(record):
        return None
    pace = np.abs(shapes.slope(plate, record.time))
    fast = pace > 0.3 * np.max(pace)
    size = float(np.sum(np.abs(signals[name][fast])))
    return -float(np.sum(signals[name][fast])) / size if size > 0.0 else 0.0


def opening(record: Record) -> float:
    """Vote on the position, -1 to 1: whether a rising reading means an opening plate, by the drive or a release."""
    signals = record.signals
    plate, drive = plate_of(signals), drive_of(signals)
    if plate is None:
        return 0.0
    if is_release(record):
        ends = max(1, plate.size // 50)
        size = max(shapes.span(plate), 1e-300)
        return float(np.clip((np.mean(plate[:ends]) - np.mean(plate[-ends:])) / size, -1.0, 1.0))
    if "setpoint" in signals or drive is None:
        return 0.0
    samples = max(3, plate.size // 50)
    return shapes.correlation(shapes.smooth(drive, samples), shapes.smooth(plate, samples))


# quantity -> vote of a record, -1 to 1, or None; and the meaning of a negative vote
_VOTES: tuple[tuple[str, Callable[[Record], float | None], str], ...] = (
    ("voltage", _leads, "negative volts open the plate"),
    ("current", _power, "it runs against the voltage"),
    ("motor_speed", _speed, "the motor runs against its voltage"),
    ("emf", _emf, "it is positive while the released plate closes"),
    (
        "voltage",
        lambda record: None if record.take("emf") else _emf(record, "voltage"),
        "it is positive while the released plate closes",
    ),
    ("position", opening, "it falls while the plate opens"),
)


class Shown(NamedTuple):
    """A rig test; "" if none fits."""

    test: str
    reason: str
    sure: bool


def rig_test_of(record: Record) -> Shown:
    """The rig test from the record's signals; if they leave it open, from the name of file, folder or group."""
    shown, named = _by_signals(record), _by_name(record)
    if not named:
        signals = record.signals
        lacks = plate_of(signals) is None or drive_of(signals) is None
        if not record.unexplained or not lacks or "setpoint" in signals:
            return shown
        # the test follows from a signal that was not logged, and an unexplained column may be that signal
        reason = f"{shown.reason}; but it is not known what '{record.unexplained[0]}' is, which moves"
        return shown._replace(reason=reason, sure=False)
    if named == shown.test:
        return shown
    if any({named, shown.test} <= family for family in _FAMILIES):
        return Shown(named, f"by its name, and {shown.reason}", True)
    return shown._replace(reason=f"{shown.reason}; its name says {named}", sure=False)


def _by_name(record: Record) -> str:
    """The test in the name of file, folder or group."""
    parts = record.sheet.file.replace("\\", "/").split("/")[-2:]
    for text in (record.sheet.part, parts[-1].rpartition(".")[0], *parts[:-1]):
        slug = re.sub(r"[^\wäöü]+", "_", text.casefold())
        if test := next((test for test, pattern in _NAMES if re.search(pattern, slug)), ""):
            return test
    return ""


def _by_signals(record: Record) -> Shown:
    signals, time = record.signals, record.time
    plate, drive = plate_of(signals), drive_of(signals)
    if plate is None:
        return _without_plate(signals, time)
    if "setpoint" in signals:
        took = time[-1] - time[0]
        if shapes.one_frequency(time, signals["setpoint"]):
            return Shown("sine", "the setpoint is one sine", True)
        if took > _BENCH_S:
            return Shown("drive", f"a setpoint over {took:.0f} s: a log from the car", record.sheet.is_ecu)
        return Shown("closed_loop", "position follows a setpoint", True)
    if record.sheet.is_ecu and drive is None:
        return Shown("drive", "a position in an engine computer's log, and no setpoint", True)
    if is_release(record):
        return _released(plate, signals, time)
    if drive is None:
        return Shown("", "a position, and nothing that drives the plate", False)
    name = next(each for each in ("voltage", "duty", "torque") if each in signals)
    if shapes.is_ramp(time, drive, _RAMP_S):
        return Shown("static_load", f"{name} rises slowly once and falls slowly once, and the plate follows", True)
    return Shown("response", f"{name} drives the plate, in no slow ramp", True)


def _without_plate(signals: Mapping[str, np.ndarray], time: np.ndarray) -> Shown:
    drive = drive_of(signals, ("voltage", "duty"))
    if "current" not in signals or drive is None:
        return Shown("", f"{', '.join(signals) or 'nothing'} alone: no rig test has only that", False)
    current = signals["current"]
    if "motor_speed" in signals:
        return Shown("viscous", "voltage, current and the motor's speed, and no plate: the motor runs alone", True)
    rise = shapes.steps_followed(time, drive, current)
    if rise >= _RESOLVED:
        return Shown("inductance", f"no plate, and the current rises over {rise} samples after a step", True)
    # if the current is no function of the voltage, the motor turns
    samples = max(1, drive.size // 20)
    volts, amperes = shapes.smooth(drive, samples), shapes.smooth(current, samples)
    still = shapes.span(volts) < max(4.0 * shapes.noise(drive), ONE_LEVEL * float(np.max(np.abs(volts))))
    if not still and shapes.explained(amperes, volts) < _HELD:
        return Shown("response", "no plate logged, and the current is not v/R: the plate moves", False)
    return Shown("resistance", "no plate, and the current is constant at v/R: the plate is held", True)


def _released(plate: np.ndarray, signals: Mapping[str, np.ndarray], time: np.ndarray) -> Shown:
    falls = max(shapes.falls(plate), shapes.falls(-plate), key=len)
    if len(falls) != 1:
        return Shown("", f"a position that falls {len(falls)} times, and nothing that drives it", False)
    ((high, low),) = falls
    took = float(time[low] - time[high])
    if {"emf", "voltage"} & set(signals):
        return Shown("back_emf", "no current; a voltage follows the speed of a plate let go", took < RELEASE_S)
    return Shown("inertia", f"nothing drives the plate, and it falls within {took:.2g} s: let go", took < RELEASE_S)


@dataclass(frozen=True)
class NameplateGuess:
    """A guess for one table or key of rig.toml: its lines, a short text, and the reason."""

    text: str
    short: str
    reason: str


def nameplate_guesses(records: Sequence[Record], known: RigConfig | None) -> list[NameplateGuess]:
    """Guesses for missing values of rig.toml, from all records together: sensor, travel, supply."""
    found = []
    if known is None or known.tps is None:
        found.append(_sensor([record for record in records if record.take("tps") is not None]))
    if known is None:
        angles = [r for r in records if (take := r.take("position")) and not is_percent(take.unit)]
        duties = [r for r in records if r.take("duty") and not {"voltage", "supply"} & set(r.signals)]
        found += [_travel(angles), _supply(duties)]
    return [guess for guess in found if guess is not None]


def _sensor(records: Sequence[Record]) -> NameplateGuess | None:
    """[tps] from the lowest and highest reading."""
    if not records:
        return None
    low, high = _ends([record.signals["tps"] for record in records])
    rising = sum(opening(record) for record in records) >= 0.0
    closed, opened = (round(each, 4) for each in ((low, high) if rising else (high, low)))
    reason = (
        f"lowest and highest reading of {len(records)} records, it {'rises' if rising else 'falls'} while the plate "
        "opens; 90 degrees are assumed. The ends are right only if the plate reached both stops"
    )
    text = f"[tps]\nclosed_V = {closed}\nopen_V = {opened}\ntravel_deg = 90.0\n"
    return NameplateGuess(text, f"[tps] {closed:g} V closed, {opened:g} V open, 90 degrees", reason)


def _travel(records: Sequence[Record]) -> NameplateGuess | None:
    """travel_deg if angles exceed the usual 0 to 90 degrees."""
    if not records:
        return None
    low, high = (math.degrees(each) for each in _ends([record.signals["position"] for record in records]))
    if _USUAL_DEG[0] - _BEYOND_DEG <= low and high <= _USUAL_DEG[1] + _BEYOND_DEG:
        return None
    text = f"travel_deg = [{round(low, 1)}, {round(high, 1)}]\n"
    reason = f"lowest and highest angle of {len(records)} records, beyond the usual 0 to 90"
    return NameplateGuess(text, f"[rig] {text.strip()}", reason)


def _supply(records: Sequence[Record]) -> NameplateGuess | None:
    """supply_V if a duty is the only input: that of a car's charged battery, or of a bench."""
    if not records:
        return None
    car = any(record.sheet.is_ecu for record in records)
    volts, where = (_CHARGED_V, "in a car") if car else (_BENCH_V, "on a bench")
    reason = f"a duty without a supply in {len(records)} records; {volts:g} V is usual {where}"
    return NameplateGuess(f"supply_V = {volts}\n", f"[rig] supply_V = {volts}", reason)


def _ends(readings: Sequence[np.ndarray]) -> tuple[float, float]:
    """Lowest and highest end over the records, each by itself, so that a long record does not hide a short one's."""
    low = min(float(np.quantile(each, _END_QUANTILE)) for each in readings)
    return low, max(float(np.quantile(each, 1.0 - _END_QUANTILE)) for each in readings)
