"""Which rig test a record shows, by what was logged and how it moves."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from . import shapes
from .record import Record, let_go
from .settings import GuessSettings

# tests between which only the operator can tell, or which a name settles
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


class Shown(NamedTuple):
    """A rig test; "" where nothing fits."""

    test: str
    reason: str
    sure: bool


def rig_test_of(record: Record, settings: GuessSettings) -> Shown:
    """By its signals; a name settles what these leave open."""
    shown = _by_signals(record, settings)
    named = _by_name(record)
    if not named:
        return _doubted(shown, record)
    if named == shown.test:
        return shown
    if any({named, shown.test} <= family for family in _FAMILIES):
        return Shown(named, f"by its name, and {shown.reason}", True)
    return shown._replace(reason=f"{shown.reason}; its name says {named}", sure=False)


def _doubted(shown: Shown, record: Record) -> Shown:
    """Unsure where a test is told by what was not logged, and a column that nothing explains may be just that."""
    signals = record.signals
    lacks = record.plate(signals) is None or record.drive(signals) is None
    if not record.unexplained or not lacks or "setpoint" in signals:
        return shown
    told = f"{shown.reason}; but nothing tells what '{record.unexplained[0]}' is, which moves"
    return shown._replace(reason=told, sure=False)


def _by_name(record: Record) -> str:
    """The test that file, folder or group is called after."""
    parts = record.sheet.file.replace("\\", "/").split("/")[-2:]
    texts = [record.sheet.part, parts[-1].rpartition(".")[0], *parts[:-1]]
    for text in texts:
        slug = re.sub(r"[^\wäöü]+", "_", text.casefold())
        for test, pattern in _NAMES:
            if re.search(pattern, slug):
                return test
    return ""


def _by_signals(record: Record, settings: GuessSettings) -> Shown:
    signals = record.signals
    plate, drive = record.plate(signals), record.drive(signals)
    if "setpoint" in signals and plate is not None:
        return _under_a_controller(record, settings)
    if plate is None:
        return _without_plate(record, settings)
    if record.sheet.is_ecu and drive is None:
        return Shown("drive", "a position in an engine computer's log, and no setpoint", True)
    if let_go(record, settings):
        return _released(record, settings)
    if drive is None:
        return Shown("", "a position, and nothing that drives the plate", False)
    name = next(each for each in ("voltage", "duty", "torque") if each in signals)
    if shapes.is_ramp(record.time, drive, settings.ramp_s):
        return Shown("static_load", f"{name} rises slowly once and falls slowly once, and the plate follows", True)
    return Shown("response", f"{name} drives the plate, in no slow ramp", True)


def _under_a_controller(record: Record, settings: GuessSettings) -> Shown:
    setpoint, time = record.signals["setpoint"], record.time
    if shapes.one_frequency(time, setpoint):
        return Shown("sine", "the setpoint is one sine", True)
    if time[-1] - time[0] > settings.bench_s:
        return Shown("drive", f"a setpoint over {time[-1] - time[0]:.0f} s: a log from the car", record.sheet.is_ecu)
    return Shown("closed_loop", "position follows a setpoint", True)


def _without_plate(record: Record, settings: GuessSettings) -> Shown:
    signals = record.signals
    if "current" not in signals or not {"voltage", "duty"} & set(signals):
        have = ", ".join(signals) or "nothing"
        return Shown("", f"{have} alone: no rig test is told by that", False)
    if "motor_speed" in signals:
        return Shown("viscous", "voltage, current and the motor's speed, and no plate: the motor runs alone", True)
    drive = signals.get("voltage", signals.get("duty"))
    assert drive is not None
    rise = shapes.steps_followed(record.time, drive, signals["current"])
    if rise >= settings.resolved:
        return Shown("inductance", f"no plate, and the current rises over {rise} samples after a step", True)
    if not _moves(record, settings):
        return Shown("resistance", "no plate, and the current stands at v/R: the plate is held", True)
    return Shown("response", "no plate logged, and the current is not v/R: the plate moves", False)


def _moves(record: Record, settings: GuessSettings) -> bool:
    """True where the current is no function of the voltage, as when the motor turns."""
    signals = record.signals
    drive = signals.get("voltage", signals.get("duty"))
    assert drive is not None
    samples = max(1, drive.size // 20)
    volts, amperes = (shapes.smooth(each, samples) for each in (drive, signals["current"]))
    still = shapes.span(volts) < max(4.0 * shapes.noise(drive), settings.one_level * float(np.max(np.abs(volts))))
    return not still and shapes.explained(amperes, volts) < settings.held


def _released(record: Record, settings: GuessSettings) -> Shown:
    signals = record.signals
    plate = record.plate(signals)
    assert plate is not None
    falls = max(shapes.falls(plate), shapes.falls(-plate), key=len)
    if len(falls) != 1:
        return Shown("", f"a position that falls {len(falls)} times, and nothing that drives it", False)
    ((high, low),) = falls
    took = float(record.time[low] - record.time[high])
    sure = took < settings.release_s
    if {"emf", "voltage"} & set(signals):
        return Shown("back_emf", "no current; a voltage follows the speed of a plate let go", sure)
    return Shown("inertia", f"nothing drives the plate, and it falls within {took:.2g} s: let go", sure)
