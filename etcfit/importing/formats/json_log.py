"""JSON: SysId's tests, and telemetry as a list of records or as lists by name.

[{"t": 0.0, "motor": "pan", "position": 2042, "load": 40}, ...]      records; `motor` or `id` parts the motors
{"pan": {"t": [0.0, ...], "position": [2042, ...]}, ...}             lists by name, a motor each
{"model": "sts3215", "entries": [...]}                              either, within an object
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..labels import column
from ..sheet import Sheet
from . import sysid
from .base import Format, Source, unreadable

_KIND = "JSON of SysId, a list of records, or lists by name"
_MOTORS = ("motor", "id", "name", "servo", "joint")  # keys of a record that name its motor


def _read(source: Source) -> list[Sheet]:
    try:
        content = json.loads(source.path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as err:
        raise unreadable(source.where, "it is no JSON, or cut off", _KIND, err) from err
    if sysid.is_sysid(content):
        return sysid.sheets_of(content, source.where)
    sheets = list(_sheets(content, source.where, ""))
    if not sheets:
        raise MeasurementError(source.where, "no table in it.", f"It must be {_KIND}.",
                               "Write one record a sample: [{\"t\": 0.0, \"position\": 2042}, ...].")  # fmt: skip
    return sheets


def _sheets(content: Any, where: str, part: str) -> Iterator[Sheet]:
    """Every table within, by the path that leads to it."""
    if isinstance(content, list) and content and all(isinstance(each, dict) for each in content):
        yield from _of_records(content, where, part)
    elif isinstance(content, dict):
        lists = {name: each for name, each in content.items() if _is_column(each)}
        if len(lists) > 1:
            yield _sheet({name: [_number(x) for x in each] for name, each in lists.items()}, where, part)
        for name, each in content.items():
            if name not in lists:
                yield from _sheets(each, where, f"{part}.{name}" if part else name)


def _of_records(records: list[Mapping[str, Any]], where: str, part: str) -> Iterator[Sheet]:
    key = next((each for each in _MOTORS if all(each in record for record in records)), None)
    motors: dict[str, list[Mapping[str, Any]]] = {}
    for record in records:
        motors.setdefault("" if key is None else str(record[key]), []).append(record)
    for motor, mine in motors.items():
        rows = [dict(_flat(each, "")) for each in mine]
        names = list(dict.fromkeys(name for row in rows for name in row if name != key))
        if names:
            path = ".".join(filter(None, (part if key is None else "", motor)))
            yield _sheet({name: [row.get(name, np.nan) for row in rows] for name in names}, where, path)


def _flat(record: Mapping[str, Any], name: str) -> Iterator[tuple[str, float]]:
    """Dotted names and numbers of a record."""
    for key, inner in record.items():
        path = f"{name}.{key}" if name else key
        if isinstance(inner, dict):
            yield from _flat(inner, path)
        elif isinstance(inner, int | float) and not isinstance(inner, bool):
            yield path, float(inner)


def _is_column(each: Any) -> bool:
    return isinstance(each, list) and len(each) > 1 and all(isinstance(x, int | float | None) for x in each)


def _number(x: Any) -> float:
    return np.nan if x is None else float(x)


def _sheet(columns: Mapping[str, list[float]], where: str, part: str) -> Sheet:
    lengths = {len(each) for each in columns.values()}
    if len(lengths) > 1:
        raise MeasurementError(where, f"lists of {', '.join(map(str, sorted(lengths)))} numbers side by side.",
                               "The lists of a table have one length.", "Write one record a sample.")  # fmt: skip
    return Sheet(where, part, tuple(column(name, np.array(each)) for name, each in columns.items()))


FORMAT = Format("JSON", (".json",), _read, motors=True)
