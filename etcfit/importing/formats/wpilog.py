"""WPILib's data log (`.wpilog`): one sheet per motor, one row for every instant of any of its entries, gaps elsewhere.

    header   "WPILOG", version (16 bit), bytes of an extra header (32 bit), the extra header
    record   lengths of the next fields (entry 2 bits, size 2 bits, time 3 bits), entry, size, time (us), payload
    entry 0  start: 0, entry, name, type, metadata (each text after its length); finish: 1; metadata: 2

All numbers are little-endian. Numbers of the types double, float and int64 are read. A text entry
`sysid-test-state-NAME` separates the tests of SysId, in which `quantity-MOTOR-NAME` are the entries of a motor. In
other logs the part before the last `/` of a name is the motor.

Source: WPILib, datalog.adoc, version 1.0; SysIdRoutineLog.java for its names and units. Differs from source: lists,
texts, truth values and structures are left out, with a remark.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise

import numpy as np

from ...errors import MeasurementError
from ..sheet import Sheet, column, time_base
from .base import Format, Source, common_rows, unreadable, with_gaps

_KIND = "a WPILib data log"
_HEADER = struct.Struct("<6sHI")
_NUMBERS = {"double": struct.Struct("<d"), "float": struct.Struct("<f"), "int64": struct.Struct("<q")}
_STATE = "sysid-test-state-"
_SYSID = re.compile(r"(voltage|position|velocity|acceleration|current)-(?P<motor>.+)")
_UNITS = {"volt": "V", "amp": "A", "rotation": "turn", "radian": "rad", "degree": "deg",
          "rotation per second": "turn/s", "radian per second": "rad/s", "degree per second": "deg/s"}  # fmt: skip
# names of SysId that differ from ours or are less specific: its voltage is the motor's input, never an EMF
_QUANTITY = {"velocity": "motor_speed", "voltage": "motor_voltage"}
_TESTS = {"quasistatic": "slow", "dynamic": "fast"}  # as SysId's JSON calls them; a free wheel is no static load
_LEAD = 200_000  # logged us before a test that belong to its trace, so that the trace begins at rest
_NONE = "none"  # state of SysId between two tests


@dataclass
class _Entry:
    """One channel of the log: times (us) and values in the order of the log."""

    name: str
    kind: str
    unit: str
    times: list[int] = field(default_factory=list)
    values: list[float | str] = field(default_factory=list)


def _read(source: Source) -> list[Sheet]:
    raw = source.path.read_bytes()
    entries, others, cut = _entries(raw, source.where)
    numbers = [each for each in entries if each.kind in _NUMBERS and each.times]
    if not numbers:
        entries_there = ", ".join(sorted(f"'{name}' ({kind})" for name, kind in others.items())[:8]) or "none"
        raise MeasurementError(source.where, f"no entry of numbers in it; there are: {entries_there}.",
                               "Entries of the type double, float or int64 are required.",
                               "Log voltage, position and velocity with DataLogManager or SysIdRoutine.")  # fmt: skip
    states = [each for each in entries if each.name.startswith(_STATE)]
    remarks = (f"left out, no numbers: {', '.join(sorted(others)[:8])}",) if others else ()
    sheets = []
    for motor, mine in _by_motor(numbers, states).items():
        sheets += _sheets(source, motor, mine, states, remarks)
    return [replace(each, losses=(*each.losses, cut)) if cut else each for each in sheets]


def _entries(raw: bytes, where: str) -> tuple[list[_Entry], dict[str, str], str]:
    """Entries of numbers and of states, types of all others by name, and a sentence on a missing end."""
    if len(raw) < _HEADER.size or raw[:6] != b"WPILOG":
        raise unreadable(where, "it does not begin as one", _KIND)
    _, version, extra = _HEADER.unpack_from(raw)
    if version >> 8 != 1:
        raise unreadable(where, f"it is of version {version >> 8}.{version & 255}", f"{_KIND} of version 1")
    at, begun, every, others = _HEADER.size + extra, {}, [], {}
    while at < len(raw):
        lengths = raw[at]
        sizes = (lengths & 3) + 1, (lengths >> 2 & 3) + 1, (lengths >> 4 & 7) + 1
        ends = list(accumulate((at + 1, *sizes)))
        if ends[-1] > len(raw):
            return every, others, f"it is cut off: a record at byte {at} does not fit in; it and what follows is lost"
        number, size, time = (int.from_bytes(raw[a:b], "little") for a, b in pairwise(ends))
        payload, at = raw[ends[-1] : ends[-1] + size], ends[-1] + size
        if len(payload) < size:
            return every, others, f"it is cut off: its last record of {size} bytes has {len(payload)}, and is left out"
        if number == 0:
            _control(payload, begun, every, others, where)
        elif (entry := begun.get(number)) is not None and (value := _value(entry, payload, where)) is not None:
            entry.times.append(time)
            entry.values.append(value)
    return every, others, ""


def _control(payload: bytes, begun: dict[int, _Entry], every: list[_Entry], others: dict[str, str], where: str) -> None:
    """A start, a finish or new metadata of an entry."""
    try:
        number = int.from_bytes(payload[1:5], "little")
        if payload[0] == 0:
            name, rest = _text(payload, 5)
            kind, rest = _text(payload, rest)
            entry = _Entry(name, kind, _unit(_text(payload, rest)[0]))
            begun[number] = entry
            if kind in _NUMBERS or name.startswith(_STATE):
                every.append(entry)
            else:
                others[name] = kind
        elif payload[0] == 1:
            begun.pop(number, None)
        elif payload[0] == 2 and number in begun:
            begun[number].unit = _unit(_text(payload, 5)[0])
    except (IndexError, struct.error, UnicodeDecodeError) as err:
        raise unreadable(where, "a control record of it is damaged", _KIND, err) from err


def _text(payload: bytes, at: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", payload, at)
    if at + 4 + size > len(payload):
        raise IndexError(f"a text of {size} bytes in a record of {len(payload)}")
    return payload[at + 4 : at + 4 + size].decode("utf-8"), at + 4 + size


def _value(entry: _Entry, payload: bytes, where: str) -> float | str | None:
    """Value of a record; None if its entry is not read."""
    if entry.name.startswith(_STATE):
        return payload.decode("utf-8", "replace")
    form = _NUMBERS.get(entry.kind)
    if form is None:
        return None
    if len(payload) != form.size:
        raise unreadable(where, f"'{entry.name}' ({entry.kind}) has a record of {len(payload)} bytes", _KIND)
    return float(form.unpack(payload)[0])


def _unit(metadata: str) -> str:
    """A unit in words or in JSON: SysId writes only `Rotation per Second`."""
    text = metadata.strip()
    if text.startswith("{"):
        try:
            found = json.loads(text)
        except json.JSONDecodeError:
            return ""
        text = str(found.get("unit") or found.get("units") or "") if isinstance(found, dict) else ""
    singular = re.sub(r"s\b", "", text.casefold())
    return _UNITS.get(singular, _UNITS.get(text.casefold(), text))


def _by_motor(entries: list[_Entry], states: list[_Entry]) -> dict[str, list[tuple[str, _Entry]]]:
    """Entries of each motor, and their names without the motor's."""
    routines = tuple(map(_routine, states))
    motors: dict[str, list[tuple[str, _Entry]]] = {}
    if states:  # a robot logs hundreds of other entries
        entries = [each for each in entries if each.name.endswith(routines)]
    for entry in entries:
        bare = next((entry.name.removesuffix(each) for each in routines if entry.name.endswith(each)), entry.name)
        if match := _SYSID.fullmatch(bare):
            motors.setdefault(match["motor"], []).append((match[1], entry))
        else:
            motor, _, name = entry.name.rpartition("/")
            motors.setdefault(motor.removeprefix("NT:").strip("/"), []).append((name, entry))
    return motors


def _sheets(
    source: Source, motor: str, mine: list[tuple[str, _Entry]], states: list[_Entry], remarks: tuple[str, ...]
) -> list[Sheet]:
    """One sheet per test of SysId, if there are any; else one sheet."""
    ticks, places = common_rows(source, [np.asarray(entry.times, dtype=np.int64) for _, entry in mine], len(mine))
    columns = []
    for (name, entry), rows in zip(mine, places, strict=True):
        made = column(_QUANTITY.get(name, name), with_gaps(ticks.size, rows, entry.values), entry.unit)
        columns.append(replace(made, label=entry.name))

    def within(part: str, begin: int, end: int) -> Sheet:
        inside = (ticks >= begin) & (ticks <= end)
        cut = [replace(each, values=each.values[inside]) for each in columns]
        return Sheet(source.where, part, (time_base(1e-6 * (ticks[inside] - ticks[inside][0])), *cut), remarks)

    routines = [state for state in states if any(entry.name.endswith(_routine(state)) for _, entry in mine)]
    spans = [span for state in routines for span in _tests(state)]
    if not spans:
        return [within(motor, ticks[0], ticks[-1])]
    made, free = [], 0  # instant from which on no test runs
    for test, begin, end in spans:
        made.append(within(f"{motor}: {test}", max(free, begin - _LEAD), end))
        free = end + 1
    return made


def _routine(state: _Entry) -> str:
    """The end of the names of a routine's entries in SysId."""
    return f"-{state.name.removeprefix(_STATE)}"


def _tests(state: _Entry) -> list[tuple[str, int, int]]:
    """Each test of SysId: its name, its first and its last instant, us."""
    found: list[tuple[str, int, int]] = []
    for time, value in sorted(zip(state.times, state.values, strict=True)):
        if value == _NONE:
            continue
        if found and found[-1][0] == value:
            found[-1] = (found[-1][0], found[-1][1], time)
        else:
            found.append((str(value), time, time))
    return [("-".join(_TESTS.get(word, word) for word in name.split("-")), begin, end) for name, begin, end in found]


FORMAT = Format("WPILib data log", (".wpilog",), _read, motors=True)
