"""What the name of a column says, in the words of benches, scopes and engine computers."""

from __future__ import annotations

import re

from .makers import known, words

# first match wins; matched against lower-case words parted by single spaces
_WORDS: tuple[tuple[str, str], ...] = (
    ("time", r"^(t|x|time|zeit|temps|timestamp|zeitstempel|seconds?|x value)$|^(time|zeit|elapsed|timestamp)\b"),
    ("", r"\b(pedal|accelerator|app)\b"),  # of the driver's foot, never of the plate
    ("setpoint", r"\b(set ?point|target|desired|demand(ed)?|soll(wert)?|reference|ref|command(ed)?|request(ed)?)\b"),
    ("emf", r"\b(b ?emf|emf|e ?b|emk|gegen ?emk|induced|generator)\b"),
    ("supply", r"\b(supply|batt?(ery)?|[uv] ?batt?|kl ?30|versorgung\w*|vcc|v ?supply|u ?b)\b"),
    ("duty", r"\b(duty|pwm|tastgrad|tastverh\w*)\b"),
    ("motor_speed", r"\b(speed|rpm|\w*drehzahl|omega|n ?mot(or)?|w|tacho?(meter)?)\b"),
    ("current", r"\b(currents?|curr|\w*strom|amps?|amperes?|shunt|clamp|\w*zange)\b|\bi( ?(a|m|mot|motor|arm|dc))?$"),
    ("torque", r"\b(torque|\w*moment)\b"),
    ("temperature", r"\b(temp\w*|ntc|pt ?100)\b"),
    ("position", r"\b(tps? ?\d?|throttle|pos(ition)?|angle|\w*winkel|theta|alpha|phi|plate|blade|\w*klappe\w*|poti"
                 r"|potentiometer|wiper|opening|\w*stellung|enc(oder)? ?\d*)\b"),
    ("voltage", r"\b(voltages?|volts?|\w*spannung|terminals?|klemmen?)\b|\b[uv]( ?(a|m|in|out|dc|arm|mot|motor))?$"),
)  # fmt: skip
_PATTERNS = tuple((quantity, re.compile(pattern)) for quantity, pattern in _WORDS)
_NUMBERED = re.compile(r"(voltage|signal|channel|analog) ?\d*")  # what data loggers call any input
_OF_THE_MOTOR = re.compile(r"\b(mot(or)?|omega|w|tacho?(meter)?)\b")


def quantity_named(name: str) -> str | None:
    """The quantity that a name says; "" where it is something else than the rig's, None where it says nothing."""
    if found := known(name):
        return found[0]
    said = words(name)
    if _NUMBERED.fullmatch(said):
        return None
    return next((quantity for quantity, pattern in _PATTERNS if pattern.search(said)), None)


def is_of_the_motor(name: str) -> bool:
    """True for a speed that is the motor's by its name; an ECU's RPM is the engine's."""
    return _OF_THE_MOTOR.search(words(name)) is not None
