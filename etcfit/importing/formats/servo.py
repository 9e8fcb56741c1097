"""Registers of bus servos as physical quantities: counts per turn, signs in a bit or in two's complement.

    sign in bit b:        x = (raw mod 2^b) (1 - 2 bit_b(raw))         1056 -> -32 for b = 10
    two's complement:     x = raw - 2^B if raw >= 2^(B - 1)

A column is a register by its name, `Present_Load`, `load (5)` or `shoulder_pan.load`; the part of the name for a motor,
or a column `id`, separates the motors. The load of a Feetech or an AX is the duty of its bridge, not a torque; that of
an X is an estimate, and is left out if its PWM is logged. A speed is that of the output, which follows from the
position: it is left out too.

Source: Feetech, memory tables of STS/SMS and SCS servos (counts a turn and signs as LeRobot's
motors/feetech/tables.py; load 0.1 % of the duty, sign in bit 10; voltage 0.1 V; current 6.5 mA, sign in bit 15: units
as python-st3215 has them); ROBOTIS e-Manual, control tables of DYNAMIXEL X
(emanual.robotis.com/docs/en/dxl/x/xm430-w350, 4096 counts a turn, PWM 0.113 %, 0.1 V, 2.69 mA; XL330 and XC330 1 mA)
and AX (emanual.robotis.com/docs/en/dxl/ax/ax-12a, 0.29 degrees, load 0.1 %, sign in bit 10, 0.1 V). Differs from
source: no.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...errors import MeasurementError, UsageError
from ...rig.columns import without_sign_bit
from ..sheet import TIME, Column, Sheet


class Register(NamedTuple):
    """The meaning of one register."""

    quantity: str  # quantity of a measurement folder's CSV
    unit: str  # unit of one count, as `rig.units` reads it
    sign: int | None = None  # sign bit, or None
    width: int = 0  # bits of a number in two's complement; 0 for other numbers
    most: int | None = None  # largest possible magnitude in counts; None for any


@dataclass(frozen=True)
class Servo:
    """One family: its title, and its registers by the word in their names."""

    title: str
    registers: Mapping[str, Register]


def _servo(title: str, position: Register, **more: Register) -> Servo:
    """A family with the common registers and its own ones for drive and current."""
    return Servo(title, {"goal": position._replace(quantity="setpoint"), "position": position, **more,
                         "voltage": Register("supply", "0.1 V"), "temperature": Register("temperature", "degC")}
                 )  # fmt: skip


def _x(title: str, milliamperes: float) -> Servo:
    return _servo(title, Register("position", f"{360.0 / 4096:.12g} deg", width=32),
                  pwm=Register("duty", "0.113 %", width=16, most=885),
                  current=Register("current", f"{milliamperes:g} mA", width=16))  # fmt: skip


_SCS = Register("position", f"{300.0 / 1024:.12g} deg")
_FEETECH = {"load": Register("duty", "0.1 %", sign=10, most=1000), "current": Register("current", "6.5 mA", sign=15)}
SERVOS: Mapping[str, Servo] = {
    "feetech-sts": _servo("Feetech STS/SMS", Register("position", f"{360.0 / 4096:.12g} deg", sign=15), **_FEETECH),
    "feetech-scs": _servo("Feetech SCS", _SCS, **_FEETECH),
    "dynamixel-xm": _x("DYNAMIXEL XM, XH, XW", 2.69),
    "dynamixel-xl330": _x("DYNAMIXEL XL330, XC330", 1.0),
    "dynamixel-ax": _servo("DYNAMIXEL AX", _SCS, load=Register("duty", "0.1 %", sign=10, most=1023)),
}
"""Servos by the name for `--servo`."""

# word in a name -> register; the first match counts
_WORDS = (("goal", r"goal|target|command"), ("position", r"pos(ition)?"), ("pwm", r"pwm"), ("load", r"load"),
          ("current", r"current"), ("voltage", r"voltage|volt"), ("temperature", r"temp(erature)?"))  # fmt: skip
_AGAINST = 0.5  # share of the power that must be negative for a duty to count as having the wrong sign
_TIMES = re.compile(r"t|time|timestamp\w*|ts|seconds", re.IGNORECASE)
_IDS = ("id", "motor", "servo", "motor_id", "servo_id")  # names of a column with the motor of each row
_NUMBER = re.compile(r"(?P<name>.*?)\s*\((?P<motor>\d+)\)")  # load (5)
_PATH = re.compile(r"(?P<motor>.+)[./](?P<name>[^./]+)")  # shoulder_pan.load


def named(name: str) -> Servo:
    """The servo with this name.

    Raises:
        UsageError: there is none.
    """
    if name not in SERVOS:
        raise UsageError(f"--servo {name}: no such servo. Known: {', '.join(SERVOS)}.")
    return SERVOS[name]


def decoded(sheet: Sheet, servo: Servo) -> list[Sheet]:
    """Registers as quantities, one sheet per motor.

    Raises:
        MeasurementError: no register among the columns, or a number that a register cannot have.
    """
    if (by := next((each for each in sheet.columns if each.name.casefold() in _IDS), None)) is not None:
        rows = [replace(sheet, part=f"{motor:g}", columns=tuple(
            replace(each, values=each.values[by.values == motor]) for each in sheet.columns if each is not by))
            for motor in np.unique(by.values[np.isfinite(by.values)])]  # fmt: skip
        return [each for row in rows for each in decoded(row, servo)]
    time = next((each for each in sheet.columns if each.quantity == TIME or _TIMES.fullmatch(each.name)), None)
    motors: dict[str, list[tuple[str, Column]]] = {}
    for column in sheet.columns:
        if column is not time and (found := _register(column.label)) is not None:
            motors.setdefault(found[0], []).append((found[1], column))
    if not motors:
        there = ", ".join(f"'{each.label}'" for each in sheet.columns[:12])
        raise MeasurementError(sheet.where, f"no register of a servo among its columns: {there}.",
                               "Names such as position, load, speed, current, voltage or goal are required.",
                               "Leave --servo out, or name the columns so.")  # fmt: skip
    made = []
    for motor, columns in motors.items():
        own, turned = _driving(tuple(_columns(sheet, servo, columns)))
        part = ".".join(filter(None, (sheet.part, motor)))
        clock = () if time is None else (time,)
        said = (f"registers of {servo.title}: its load or PWM is taken as the duty of the bridge" + turned,)
        made.append(replace(sheet, part=part, columns=(*clock, *own), remarks=(*sheet.remarks, *said)))
    return made


def _driving(columns: tuple[Column, ...]) -> tuple[tuple[Column, ...], str]:
    """The columns with the duty's sign turned if it is opposite to the speed, as a Feetech's load is; and a remark on
    it.

    A driven motor takes power: sum(duty dtheta/dt) > 0.
    """
    found = {each.name: each for each in columns}
    if not {"position", "duty"} <= set(found):
        return columns, ""
    power = found["duty"].values * np.gradient(found["position"].values)
    power = power[np.isfinite(power)]
    if not np.any(power) or np.sum(power) > -_AGAINST * np.sum(np.abs(power)):
        return columns, ""
    turned = tuple(replace(each, values=-each.values) if each.name == "duty" else each for each in columns)
    return turned, ", its sign turned: it drove the position down where it was positive"


def _register(label: str) -> tuple[str, str] | None:
    """Motor and register of a column's label; None if it is no register."""
    match = _NUMBER.fullmatch(label) or _PATH.fullmatch(label)
    motor, name = (match["motor"].strip(), match["name"]) if match else ("", label)
    spoken = " ".join(re.sub(r"[^a-zA-Z]+", " ", name).split()).casefold()
    word = next((word for word, form in _WORDS if re.search(rf"\b({form})\b", spoken)), None)
    if word is None or (word == "goal" and re.search(r"\b(speed|velocity|vel|load|pwm|current)\b", spoken)):
        return None
    return motor, word


def _columns(sheet: Sheet, servo: Servo, columns: list[tuple[str, Column]]) -> Iterator[Column]:
    for word, column in columns:
        register = servo.registers.get(word)
        if register is None:
            continue
        values = _signed(column.values, register)
        whole = values[np.isfinite(values)]
        if np.any(whole != np.round(whole)):
            raise MeasurementError(sheet.where, f"'{column.label}' holds {whole[whole != np.round(whole)][0]:g}.",
                                   f"Registers of {servo.title} are whole numbers.",
                                   "It is in physical units already: leave --servo out.")  # fmt: skip
        if register.most is not None and whole.size and np.max(np.abs(whole)) > register.most:
            raise MeasurementError(sheet.where, f"'{column.label}' reaches {np.max(np.abs(whole)):g} counts.",
                                   f"{word} of {servo.title} stays within {register.most}.",
                                   f"Name your servo: --servo with one of {', '.join(SERVOS)}.")  # fmt: skip
        yield replace(column, name=register.quantity, unit=register.unit, values=values)


def _signed(raw: np.ndarray, register: Register) -> np.ndarray:
    """Counts with their sign, shape (n,); negative counts stay as they are."""
    values = np.array(raw, dtype=float)
    if register.sign is not None:
        return without_sign_bit(values, register.sign)
    if register.width:
        beyond = values >= 2.0 ** (register.width - 1)
        values[beyond] -= 2.0**register.width
    return values
