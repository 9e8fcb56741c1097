"""units.csv: what is written down about each unit, beside its measurements."""

from __future__ import annotations

import csv
import datetime
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from ..errors import MeasurementError
from ..rig.table import decode
from ..rig.toml import Toml, closest

ZERO_CELSIUS = 273.15  # K


@dataclass(frozen=True)
class Member:
    """A unit's row; what an empty cell or a missing column does not tell is None.

    Args:
        serial: of the unit.
        date: when it was measured; in UTC where the file says an offset.
        batch, rig, operator: where it comes from, on what and by whom it was measured.
        temperature: of the room, K.
        part: the physical throttle; units that share it are repeats.
    """

    serial: str | None = None
    date: datetime.datetime | None = None
    batch: str | None = None
    rig: str | None = None
    operator: str | None = None
    temperature: float | None = None
    part: str | None = None


COLUMNS = {"unit": "unit", **{each.name: each.name for each in fields(Member)}, "temperature": "temperature_C"}


def read_members(raw: bytes, path: str, toml: Toml, units: Sequence[str]) -> dict[str, Member]:
    """Unit -> its row, in the order of the file.

    Args:
        raw: the file.
        path: what messages call it.
        toml: fleet.toml, whose [units] may name the columns.
        units: the folders that there are.

    Raises:
        MeasurementError: a column, a cell or a row is wrong, or rows and folders do not match.
    """
    frame = _frame(decode(raw, path).removeprefix("\ufeff"), path)
    columns = _columns(toml, list(frame.columns), path)
    members: dict[str, Member] = {}
    lines: dict[str, int] = {}
    for line, row in zip(frame.index, frame.to_dict("records"), strict=True):
        unit = row[columns["unit"]]
        where = f"{path}:{line}"
        if not unit:
            raise MeasurementError(where, f"{columns['unit']} is empty.", "Every row names its unit.", "Fill it in.")
        if unit in members:
            raise MeasurementError(where, f"unit {unit} has a row already, in line {lines[unit]}.",
                                   "A unit has one row.", "Delete one; repeats of a part are units of their own, "
                                   "with the same `part`.")  # fmt: skip
        if unit not in units:
            raise MeasurementError(where, f"unit {unit} has no folder.", "Each row is a folder beside this file.",
                                   closest(unit, units, "Delete the row, or put its folder there."))  # fmt: skip
        members[unit], lines[unit] = _member(row, columns, where), line
    if missing := [unit for unit in units if unit not in members]:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        raise MeasurementError(path, f"no row for {', '.join(missing[:3])}{more}.", "Each folder has a row.",
                               "Add rows with the folders' names; cells may be empty.")  # fmt: skip
    return members


def _frame(text: str, path: str) -> Any:
    """The cells as text, stripped; the index is the line of each row."""
    import pandas as pd

    lines = text.split("\n")
    separator = max(",;\t", key=lines[0].count)
    # by hand up to the frame: pandas drops a cell too many, or fills one too few, without a word
    rows = [(number, row) for number, row in _rows(text, separator) if any(row)]
    if not rows:
        raise MeasurementError(path, "it is empty.", "A header and a row for each unit are required.",
                               "Write `unit,serial,date`, or delete the file.")  # fmt: skip
    header = rows[0][1]
    if twice := [name for name in header if header.count(name) > 1]:
        raise MeasurementError(f"{path}:1", f"column '{twice[0]}' stands there twice.", "A column has one name.",
                               "Rename or delete one.")  # fmt: skip
    for number, row in rows:
        if len(row) != len(header):
            raise MeasurementError(f"{path}:{number}", f"{len(row)} cells.", f"The header has {len(header)}.",
                                   'Correct the row; a text with a comma needs quotes: "a, b".')  # fmt: skip
    return pd.DataFrame([row for _, row in rows[1:]], columns=header, index=[number for number, _ in rows[1:]])


def _rows(text: str, separator: str) -> list[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text), delimiter=separator)
    return [(reader.line_num, [cell.strip() for cell in row]) for row in reader]


def _columns(toml: Toml, header: list[str], path: str) -> dict[str, str]:
    """What each column is called here; only those that are there."""
    given: Mapping[str, Any] = toml.table("units", COLUMNS)
    for role, name in given.items():
        if toml.string(f"units.{role}", name) not in header:
            raise toml.wrong(f"units.{role}", f"found '{name}'.", f"{path} has: {', '.join(header)}.",
                             closest(name, header, "Correct it, or delete the line."))  # fmt: skip
    columns = {role: name for role, name in {**COLUMNS, **given}.items() if name in header}
    if "unit" not in columns:
        raise MeasurementError(f"{path}:1", f"no column 'unit' among {', '.join(header)}.",
                               "It holds the names of the folders.",
                               f'Add it, or write [units] unit = "{header[0]}" in fleet.toml.')  # fmt: skip
    return columns


def _member(row: Mapping[str, str], columns: Mapping[str, str], where: str) -> Member:
    def cell(role: str, read: Callable[[str, str, str], Any]) -> Any:
        text = row.get(columns.get(role, ""), "")
        return read(text, columns[role], where) if text else None

    texts = {role: cell(role, lambda text, *_: text) for role in ("serial", "batch", "rig", "operator", "part")}
    return Member(**texts, date=cell("date", _date), temperature=cell("temperature", _temperature))


def _date(text: str, column: str, where: str) -> datetime.datetime:
    try:
        date = datetime.datetime.fromisoformat(text)
    except ValueError as error:
        raise MeasurementError(where, f"{column}: '{text}'.", "It must be a date of ISO 8601.",
                               "Write 2026-07-31, or 2026-07-31T14:05.") from error  # fmt: skip
    return date if date.tzinfo is None else date.astimezone(datetime.UTC).replace(tzinfo=None)


def _temperature(text: str, column: str, where: str) -> float:
    try:
        kelvin = float(text) + ZERO_CELSIUS
    except ValueError:
        kelvin = math.nan
    if not 0.0 < kelvin < 1000.0:
        raise MeasurementError(where, f"{column}: '{text}'.", "It must be a temperature in degrees Celsius.",
                               "Write 23.5, or leave the cell empty.")  # fmt: skip
    return kelvin
