"""JSON: SysId's tests, and telemetry as a list of records or as lists by name.

[{"t": 0.0, "motor": "pan", "position": 2042, "load": 40}, ...]      records; `motor` or `id` separates the motors
{"pan": {"t": [0.0, ...], "position": [2042, ...]}, ...}             lists by name, one motor each
{"model": "sts3215", "entries": [...]}                              either, within an object

SysId's tests of one mechanism are rows of time, voltage, position and velocity:

{"sysid": true, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0,
 "slow-forward": [[s, V, position, velocity], ...], "fast-backward": ...}

A drivetrain has rows of time, V left and right, positions and velocities likewise, angle and its rate: two motors.

Source: WPILib, sysid/docs/data-collection.md. Differs from source: units of length are refused, because a motor's
equation needs angles.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..sheet import Sheet, column, time_base
from .base import Format, Source, flat_numbers, unreadable

_KIND = "JSON of SysId, a list of records, or lists by name"
_TESTS = ("slow-forward", "slow-backward", "fast-forward", "fast-backward", "track-width")
_ANGLES = {"rotations": "turn", "radians": "rad", "degrees": "deg"}
_SIMPLE = "motor_voltage", "position", "motor_speed"  # columns after the time
_DRIVE = 9  # cells of a drivetrain's row
_MOTORS = ("motor", "id", "name", "servo", "joint")  # keys of a record that name its motor


def _read(source: Source) -> list[Sheet]:
    try:
        content = json.loads(source.path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as err:
        raise unreadable(source.where, "it is no JSON, or cut off", _KIND, err) from err
    if isinstance(content, dict) and content.get("sysid") is True:
        return _sysid(content, source.where)
    sheets = list(_sheets(content, source.where, ""))
    if not sheets:
        raise MeasurementError(source.where, "no table in it.", f"It must be {_KIND}.",
                               "Write one record a sample: [{\"t\": 0.0, \"position\": 2042}, ...].")  # fmt: skip
    return sheets


def _sheets(content: Any, where: str, part: str) -> Iterator[Sheet]:
    """Every table in the content, with its path."""
    if isinstance(content, list) and content and all(isinstance(each, dict) for each in content):
        yield from _of_records(content, where, part)
    elif isinstance(content, dict):
        lists = {
            name: [np.nan if x is None else float(x) for x in each]
            for name, each in content.items()
            if isinstance(each, list) and len(each) > 1 and all(isinstance(x, int | float | None) for x in each)
        }
        if len(lists) > 1:
            yield _sheet(lists, where, part)
        for name, each in content.items():
            if name not in lists:
                yield from _sheets(each, where, f"{part}.{name}" if part else name)


def _of_records(records: list[Mapping[str, Any]], where: str, part: str) -> Iterator[Sheet]:
    key = next((each for each in _MOTORS if all(each in record for record in records)), None)
    motors: dict[str, list[Mapping[str, Any]]] = {}
    for record in records:
        motors.setdefault("" if key is None else str(record[key]), []).append(record)
    for motor, mine in motors.items():
        rows = [dict(flat_numbers(each)) for each in mine]
        names = list(dict.fromkeys(name for row in rows for name in row if name != key))
        if names:
            path = ".".join(filter(None, (part if key is None else "", motor)))
            yield _sheet({name: [row.get(name, np.nan) for row in rows] for name in names}, where, path)


def _sheet(columns: Mapping[str, list[float]], where: str, part: str) -> Sheet:
    lengths = {len(each) for each in columns.values()}
    if len(lengths) > 1:
        raise MeasurementError(where, f"lists of {', '.join(map(str, sorted(lengths)))} numbers side by side.",
                               "The lists of a table have one length.", "Write one record a sample.")  # fmt: skip
    return Sheet(where, part, tuple(column(name, np.array(each)) for name, each in columns.items()))


def _sysid(content: Mapping[str, Any], where: str) -> list[Sheet]:
    """One sheet per motor and test."""
    units = str(content.get("units", "")).casefold()
    if units not in _ANGLES:
        raise MeasurementError(where, f"its units are '{content.get('units')}'.",
                               f"An angle is required: {', '.join(_ANGLES)}.",
                               "Record with the encoder's angle; a wheel's radius is no business of its "
                               "motor.")  # fmt: skip
    found: list[Sheet] = []
    for test in _TESTS:
        if rows := content.get(test):
            found += _of_test(rows, where, test, _ANGLES[units])
    if not found:
        raise MeasurementError(where, "no test in it.", f"One of {', '.join(_TESTS)} is required.", "Record one.")
    return found


def _of_test(rows: Any, where: str, test: str, unit: str) -> list[Sheet]:
    widths = {len(row) if isinstance(row, list) else 0 for row in rows} if isinstance(rows, list) else {0}
    if widths not in ({1 + len(_SIMPLE)}, {_DRIVE}):
        raise MeasurementError(where, f"rows of '{test}' have {', '.join(map(str, sorted(widths)))} numbers.",
                               f"{1 + len(_SIMPLE)} of a mechanism, or {_DRIVE} of a drivetrain, are required.",
                               "Save it again with SysId.")  # fmt: skip
    try:
        table = np.array([[float(cell) for cell in row] for row in rows])
    except (TypeError, ValueError) as err:
        raise MeasurementError(where, f"a row of '{test}' holds what is no number: {err}.", "Numbers are required.",
                               "Save it again with SysId.") from err  # fmt: skip
    motors = {"left": (1, 3, 5), "right": (2, 4, 6)} if widths == {_DRIVE} else {"mechanism": (1, 2, 3)}
    units = ("V", unit, f"{unit}/s")
    return [
        Sheet(where, f"{motor}: {test}", (
            time_base(table[:, 0] - table[0, 0]),
            *(column(name, table[:, k], of) for name, k, of in zip(_SIMPLE, places, units, strict=True)),
        ))
        for motor, places in motors.items()
    ]  # fmt: skip


FORMAT = Format("JSON", (".json",), _read, motors=True)
