"""The meaning of a column's name, in the words of benches, scopes and engine computers.

Each entry of `MAKERS` is a maker with the names in its own programs. `plain_words` gives names one form:
`ETB: position target`, `etbTarget` and `dbw/target` become lower-case words separated by single spaces.

Source: rusEFI's and FOME's output channels, TunerStudio's .ini of Speeduino and MegaSquirt, exports of Haltech NSP,
ECUMaster EMU Pro and Black, HP Tuners VCM Scanner, Motorsport Electronics ME221, MoTeC M1 and AiM Race Studio as public
readers and logs have them; Link's and MaxxECU's help pages. Differs from source: no.
"""

from __future__ import annotations

import re

# maker -> quantity -> names, the surest first
MAKERS: dict[str, dict[str, tuple[str, ...]]] = {
    "rusEFI, FOME": {
        "position": ("etb position", "tps1", "tps", "throttle position sensor", "throttle position"),
        "setpoint": ("etb position target", "etb target", "etb1 target", "etb setpoint", "etb target for current pedal",
                     "electronic throttle target"),
        "supply": ("vbatt", "battery"),
        "duty": ("etb duty", "etb duty cycle", "etb1 duty", "etb1 duty cycle", "electronic throttle duty"),
    },
    "Speeduino, MegaSquirt": {"position": ("tps",), "supply": ("battery v", "batt v", "batt", "battery")},
    "Haltech": {
        "position": ("drive by wire throttle 1 position", "drive by wire throttle position", "throttle position"),
        "setpoint": ("drive by wire throttle 1 target position", "drive by wire throttle target position",
                     "drive by wire target position", "dbw throttle target position"),
        "duty": ("drive by wire throttle 1 output duty cycle", "drive by wire throttle 1 duty cycle",
                 "drive by wire throttle 1 motor duty cycle", "drive by wire motor duty cycle"),
        "supply": ("device battery voltage", "battery voltage", "ecu battery voltage"),
    },
    "ECUMaster": {
        "position": ("dbw pos", "dbw position", "dbw tps", "sensors tps1", "sensors tps", "tps1", "tps"),
        "setpoint": ("dbw target", "dbw1 target", "dbw setpoint"),
        "duty": ("dbw out dc", "dbw output", "dbw out", "dbw dc", "dbw duty", "dbw duty cycle", "dbw motor dc"),
        "supply": ("sensors battery voltage", "battery voltage"),
    },
    "Link": {
        "position": ("e throttle 1 position", "tp main", "tps main", "tp", "throttle position"),
        "setpoint": ("e throttle target", "e throttle 1 target", "e throttle target position", "tp target",
                     "tps target"),
        "duty": ("e throttle dc", "e throttle 1 dc", "e throttle duty cycle", "e throttle motor dc",
                 "e throttle 1 motor dc"),
        "supply": ("ecu volts",),
    },
    "MaxxECU": {
        "position": ("e throttle position", "e throttle pos", "ethrottle position", "ethrottle pos"),
        "setpoint": ("e throttle target", "ethrottle target", "e throttle target pos"),
        "duty": ("e throttle duty", "e throttle motor duty", "ethrottle duty"),
    },
    "MoTeC": {
        "position": ("throttle servo bank 1 position", "throttle servo position", "throttle position", "throttle pos"),
        "setpoint": ("throttle servo bank 1 aim", "throttle servo aim", "throttle aim", "throttle position aim",
                     "throttle pos aim"),
        "duty": ("throttle servo bank 1 duty cycle", "throttle servo bank 1 motor duty cycle",
                 "throttle servo duty cycle", "throttle servo bank 1 motor output"),
    },
    "AiM": {"position": ("ecu throttle", "ecu tps", "ecu tps1", "tps1", "tps"), "setpoint": ("ecu throttle target",)},
    "Emtron, AEM, Syvecs": {
        "position": ("dbw1 position", "dbw tps1", "throttle1 position", "throttle a position"),
        "setpoint": ("dbw1 target", "dbw target position", "throttle1 target", "throttle a target", "throttle target"),
        "duty": ("dbw1 duty", "dbw1 motor duty", "dbw motor duty", "throttle1 duty"),
    },
    "HP Tuners, OBD": {
        "position": ("throttle angle", "throttle position sae", "absolute throttle position sae",
                     "absolute throttle position", "throttle position", "throttle position manifold",
                     "relative throttle position"),
        "setpoint": ("throttle desired angle", "desired throttle angle", "commanded throttle actuator position sae",
                     "commanded throttle actuator position", "commanded throttle actuator control",
                     "commanded throttle actuator", "desired throttle position", "throttle position desired"),
    },
    "Motorsport Electronics": {
        "position": ("throttle pos 1", "throttle plate pos 1"), "setpoint": ("target tpps",), "duty": ("dbw pwm duty",)
    },
    "Bosch by ECUx, VCDS": {
        "position": ("throttle plate angle", "throttle valve angle", "wdkba"),
        "setpoint": ("throttle plate angle desired", "throttle valve angle specified", "wdks w", "wdks"),
    },
    "RomRaider, Subaru": {
        "position": ("throttle opening angle", "throttle plate opening angle"),
        "setpoint": ("target throttle plate position", "requested throttle", "throttle target opening angle"),
        "duty": ("throttle motor duty", "throttle motor duty cycle"),
    },
    "any": {
        "setpoint": ("throttle target", "target throttle", "throttle position target", "throttle setpoint"),
    },
}  # fmt: skip
# further signals that `etcfit drive` shows; the surest first, letters and numbers only
LOGGED_DUTY = ("duty", "etbduty", "etbdutycycle", "dbwduty", "dbwdutycycle", "dbwmotorduty", "ethrottleduty",
               "throttleduty", "ethrottlemotorduty", "throttlemotorduty", "etbmotorduty", "motorduty", "etb1duty",
               "ethrottle1motordc")  # fmt: skip
FIRST_SENSOR = ("tps1", "tps", "tpmain", "tpsmain", "tpsa", "tps1a", "rawtps1primary", "rawtps1", "tps1primary",
                "tps1pri", "throttleposition1", "throttlepositiona", "etbposition1", "tpsvoltage", "tps1voltage",
                "tpmainvoltage")  # fmt: skip
SECOND_SENSOR = ("tps2", "tpsub", "tpssub", "tpsb", "tps1b", "rawtps1secondary", "tps1secondary", "tps1sec",
                 "throttleposition2", "throttlepositionb", "etbposition2", "tps2voltage", "tpsubvoltage")  # fmt: skip
PEDAL_IN_SOME = frozenset({"tp", "tps", "tps1"})  # the pedal, if another column has the plate's own name (MaxxECU)

# words of engines, gearboxes and cars only
_ENGINE = re.compile(
    r"\b(engine|eng|rpm|afr\w*|lambda|ego\w*|gego|wbo?2?|wideband|o2|oxygen|nox|egr|scr|cataly\w*|clt|coolant|iat|mat|"
    r"map|maf|baro\w*|egt\w*|ign\w*|spark|timing|dwell|adv(ance)?|inj\w*|fuel\w*|pw\d?|boost|turbo|wastegate|wg|idle|"
    r"iac|vvt|cam|crank|knock|launch|als|fan|ac|alternator|alt|gear\w*|gearbox|drivetrain|clutch|dsg|shift|brake|wheel|"
    r"vehicle|veh|car|gps|lap|oil|ve\d?|"
    r"squirt|gammae|gair|gwarm|gbaro|torque reduction|traction|flex|ethanol|nitrous|water|air ?flow|mass air\w*|"
    r"stoich\w*|cruise|secl|sync|manifold|exhaust|intake|ambient|warmup|accel(erator)?|pedal|pps\d?|apps?\d?|aps)\b"
)
_MOTOR = re.compile(r"\b(mot(or)?|omega|tacho?(meter)?|armature)\b")
# words of the plate's drive
_PLATE = re.compile(
    r"\b(etb\d?|dbw\d?|e ?throttle|throttle\d?|drive by wire|plate|blade|tp|tps\d?|\w*klappe\w*|motor|servo)\b"
)
_PLATES_POSITION = re.compile(
    r"\b(etb|dbw|e ?throttle|throttle|drive by wire)\d?( (servo|bank|body|plate|valve|blade|throttle|motor|\d))*"
    r" pos(ition)?( (actual|main|sub|real|feedback|sensor|\d))*$"
)
_TPS_LIKE = re.compile(r"(\w+ )?(tps\d?|throttle( angle| opening)?)( (main|sub|\d))?( (pos(ition)?|value))?")
# words of quantities derived from a signal: its raw reading, its error, a correction
_ABOUT = re.compile(
    r"\b(adc|raw|error|err|errors|delta|dot|acc|acceleration|rate|status|state|fault|diagnostic|mod|trim|comp|correction|"
    r"corr|table|limit|min|max|threshold|delay|learn\w*|cal|calibration|idle|fuel|ign\w*|gain|integral|[pid]|"
    r"[pid] term|transient|sensor state|count|moving|mode|active|enabled?|flags?|bias|feed ?forward)\b"
)
# the first match counts; matched against lower-case words separated by single spaces
_WORDS: tuple[tuple[str, str], ...] = (
    ("time", r"^(t|x|time|zeit|temps|timestamp|zeitstempel|seconds?|x value)$|^(time|zeit|elapsed|timestamp)\b"),
    ("", r"\b(pedal|accelerator|app)\b"),  # the driver's pedal, never the plate
    ("setpoint", r"\b(set ?point|target|desired|demand(ed)?|soll(wert)?|reference|ref|command(ed)?|request(ed)?)\b"),
    ("emf", r"\b(b ?emf|emf|e ?b|emk|gegen ?emk|induced|generator)\b"),
    ("supply", r"\b(supply|batt?(ery)?|[uv] ?batt?|kl ?30|versorgung\w*|vcc|v ?supply|u ?b)\b"),
    ("duty", r"\b(duty|pwm|tastgrad|tastverh\w*)\b"),
    ("motor_speed", r"\b(speed|velocity|rpm|\w*drehzahl|omega|n ?mot(or)?|w|tacho?(meter)?)\b"),
    ("current", r"\b(currents?|curr|\w*strom|amps?|amperes?|shunt|clamp|\w*zange)\b|\bi( ?(a|m|mot|motor|arm|dc))?$"),
    ("torque", r"\b(torque|\w*moment)\b"),
    ("temperature", r"\b(temp\w*|ntc|pt ?100)\b"),
    ("position", r"\b(tps? ?\d?|throttle|pos(ition)?|angle|\w*winkel|theta|alpha|phi|plate|blade|\w*klappe\w*|poti"
                 r"|potentiometer|wiper|opening|\w*stellung|enc(oder)? ?\d*)\b"),
    ("voltage", r"\b(voltages?|volts?|\w*spannung|terminals?|klemmen?)\b|\b[uv]( ?(a|m|in|out|dc|arm|mot|motor))?$"),
)  # fmt: skip
_PATTERNS = tuple((quantity, re.compile(pattern)) for quantity, pattern in _WORDS)
_NUMBERED = re.compile(r"(voltage|signal|channel|analog) ?\d*")  # names of any input in data loggers
_OF_THE_MOTOR = re.compile(r"\b(mot(or)?|omega|w|tacho?(meter)?)\b")


def plain_words(name: str) -> str:
    """`motorSpeed_rpm` -> `motor speed rpm`, `DBWTarget` -> `dbw target`."""
    parted = re.sub(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])|(?<=[A-Z]{2})(?=[A-Z][a-z]{2})", " ", name)
    return " ".join(re.sub(r"[^\w]+|_", " ", parted).split()).casefold()


def _ranked() -> dict[str, tuple[str, int]]:
    found: dict[str, tuple[str, int]] = {}
    for quantities in MAKERS.values():
        for quantity, names in quantities.items():
            for k, name in enumerate(names):
                own = quantity, k + 100 * (name in PEDAL_IN_SOME)
                found[name] = min(found.get(name, own), own, key=lambda each: each[1])
    return found


_KNOWN = _ranked()


def known(name: str) -> tuple[str, int] | None:
    """The quantity with this name in a maker's programs, and its rank, 0 the surest; None if there is none."""
    return _KNOWN.get(plain_words(name)) or _KNOWN.get(plain_words(name.rpartition("/")[2]))


def is_engines(name: str) -> bool:
    """Whether a name belongs to an engine, a gearbox or a car."""
    said = plain_words(name)
    return known(name) is None and _ENGINE.search(said) is not None and _MOTOR.search(said) is None


def is_plates(name: str) -> bool:
    """Whether a name has a word of the throttle or its drive."""
    return _PLATE.search(plain_words(name)) is not None


def is_plates_position(name: str) -> bool:
    """Whether a name is the plate's own position by its words, which a TPS is not."""
    return _PLATES_POSITION.search(plain_words(name)) is not None and not is_about(name)


def may_be_position(name: str) -> bool:
    """Whether a name may be the plate's position in an engine computer's log, although no maker uses it."""
    return is_plates_position(name) or (_TPS_LIKE.fullmatch(plain_words(name)) is not None and not is_about(name))


def is_about(name: str) -> bool:
    """Whether a name is derived from a signal: a raw reading, an error, a correction."""
    return known(name) is None and _ABOUT.search(plain_words(name)) is not None


def quantity_named(name: str) -> str | None:
    """The quantity of a name; "" if it does not belong to the rig, None if the name has no meaning."""
    if found := known(name):
        return found[0]
    said = plain_words(name)
    if _NUMBERED.fullmatch(said):
        return None
    return next((quantity for quantity, pattern in _PATTERNS if pattern.search(said)), None)


def is_of_the_motor(name: str) -> bool:
    """Whether a speed is the motor's by its name; an ECU's RPM is the engine's."""
    return _OF_THE_MOTOR.search(plain_words(name)) is not None
