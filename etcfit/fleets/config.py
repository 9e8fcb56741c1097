"""fleet.toml and units.csv -> FleetConfig: every key checked, every value in SI. Both files may be missing."""

from __future__ import annotations

import csv
import datetime
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import MeasurementError, first_names
from ..rig.config import RIG_KEYS, TABLES, TPS_KEYS, config_of
from ..rig.table import decode
from ..rig.toml import Toml, closest, parse
from ..rig.units import UnitError, to_si
from .folder import is_url, text_of, units_of

FLEET_KEYS = ("name", "shared", "units")
LIMIT_KEYS = ("low", "high", "unit")
UNITS_FILE = "units.csv"
ZERO_CELSIUS = 273.15  # K
_OF_TPS = ("tps", "noise", "accuracy")  # checked with each unit, whose rig.toml may complete [tps]


@dataclass(frozen=True)
class Member:
    """A unit's row in units.csv; None where a cell is empty or its column is missing."""

    serial: str | None = None  # serial number
    date: datetime.datetime | None = None  # when it was measured; in UTC where the file states an offset
    batch: str | None = None  # production batch
    rig: str | None = None  # rig that it was measured on
    operator: str | None = None  # who measured it
    temperature: float | None = None  # temperature of the room, K
    part: str | None = None  # the physical throttle; units that share it are repeats


COLUMNS = {"unit": "unit", **{each.name: each.name for each in fields(Member)}, "temperature": "temperature_C"}


@dataclass(frozen=True)
class Limit:
    """The range that a specification allows."""

    # low, high: SI; -inf and inf where a side is open
    low: float
    high: float
    # unit, given: SI unit as pint writes it, and the unit as the file has it
    unit: str
    given: str


@dataclass(frozen=True)
class FleetConfig:
    """The content of fleet.toml and units.csv."""

    name: str  # of the fleet
    location: str  # its folder or address, as given
    shared: tuple[str, ...]  # symbols that have one value for all units
    limits: Mapping[str, Limit]  # by symbol, or by figure of the line
    members: Mapping[str, Member]  # by unit, all units, in the order of units.csv, otherwise by name
    common: Toml  # tables of a rig.toml that hold for all units

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the units, in order."""
        return tuple(self.members)


def read_fleet(location: str | Path) -> FleetConfig:
    """Read and check fleet.toml and units.csv in a fleet's folder or address; no measurements.

    Raises:
        MeasurementError: there is no unit, or fleet.toml or units.csv is wrong.
    """
    base = str(location).rstrip("/") or str(location)
    units = units_of(location)
    path, raw = f"{base}/fleet.toml", text_of(location, "fleet.toml")
    text = "" if raw is None else decode(raw, path).removeprefix("\ufeff")
    toml = Toml(path, text, parse(text, path))
    toml.only(toml.tables, ("name", "fleet", "units", "limits", *TABLES))
    fleet = toml.table("fleet", FLEET_KEYS)
    return FleetConfig(
        name=_name(toml, fleet, base),
        location=base if is_url(location) else str(Path(base).absolute()),
        shared=_shared(toml, fleet),
        limits={name: _limit(toml, name, value) for name, value in toml.table("limits").items()},
        members=_members(location, base, toml, fleet, units),
        common=_common(toml),
    )


def _name(toml: Toml, fleet: Mapping[str, Any], base: str) -> str:
    if "name" in fleet and "name" in toml.tables:
        raise toml.wrong("name", "[fleet] has a name too.", "A fleet has one name.", "Delete one.")
    if "name" in fleet:
        return toml.string("fleet.name", fleet["name"])
    default = PurePosixPath(base).name if is_url(base) else Path(base).absolute().name
    return toml.string("name", toml.tables.get("name", default))


def _shared(toml: Toml, fleet: Mapping[str, Any]) -> tuple[str, ...]:
    values = fleet.get("shared", [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise toml.refused("fleet.shared", values, "It must be a list of symbols.", 'Write shared = ["K_b"].')
    return tuple(dict.fromkeys(values))


def _limit(toml: Toml, name: str, value: Any) -> Limit:
    key = f"limits.{name}"
    if not isinstance(value, dict) or "unit" not in value or not {"low", "high"} & set(value):
        raise toml.refused(key, value, "It must name a unit, and low or high or both.",
                           f'Write {name} = {{ low = 0.1, high = 0.2, unit = "N*m" }}.')  # fmt: skip
    toml.only(value, LIMIT_KEYS, f"{key}.")
    given = toml.string(f"{key}.unit", value["unit"])
    try:
        unit, conversion = to_si(given)
    except UnitError as error:
        raise toml.wrong(key, str(error), "A unit is required.", 'Write it as "N*m/rad", "ms" or "ohm".') from error
    ends = {side: toml.finite(f"{key}.{side}", value[side]) for side in ("low", "high") if side in value}
    low, high = ({side: conversion.scale * end + conversion.offset for side, end in ends.items()}.get(side, otherwise)
                 for side, otherwise in (("low", -math.inf), ("high", math.inf)))  # fmt: skip
    if not low < high:
        raise toml.wrong(key, f"low is {value['low']} and high is {value['high']}.", "low must lie below high.",
                         "Swap them, or correct them.")  # fmt: skip
    return Limit(low, high, unit, given)


def _members(
    location: str | Path, base: str, toml: Toml, fleet: Mapping[str, Any], units: tuple[str, ...]
) -> dict[str, Member]:
    name = toml.string("fleet.units", fleet.get("units", UNITS_FILE))
    raw = text_of(location, name)
    if raw is not None:
        return _read_members(raw, f"{base}/{name}", toml, units)
    if "units" in fleet:
        raise toml.wrong("fleet.units", f"found '{name}', which is not there.", "It is a CSV next to fleet.toml.",
                         "Correct the name, or delete the line.")  # fmt: skip
    if "units" in toml.tables:
        raise toml.wrong("units", f"columns of {name}, which is not there.", "It is a CSV next to fleet.toml.",
                         "Put it there, or delete the table.")  # fmt: skip
    return dict.fromkeys(units, Member())


def _common(toml: Toml) -> Toml:
    """The tables of a rig.toml in fleet.toml, checked as far as they are complete; a unit's rig.toml may complete
    them."""
    rig = toml.table("rig", RIG_KEYS)
    if "name" in rig:
        raise toml.refused("rig.name", rig["name"], "In fleet.toml every unit would have this name.",
                           "Write [fleet] name for the fleet's, and [rig] name in a unit's own rig.toml.")  # fmt: skip
    common = Toml(toml.path, toml.source, {name: toml.tables[name] for name in TABLES if name in toml.tables}, (toml,))
    whole = set(TPS_KEYS) <= set(common.table("tps", TPS_KEYS)) or "tps" not in common.tables
    alone = common.tables if whole else {name: common.tables[name] for name in common.tables if name not in _OF_TPS}
    config_of(Toml(common.path, common.source, alone), "fleet")
    return common


def _read_members(raw: bytes, path: str, toml: Toml, units: Sequence[str]) -> dict[str, Member]:
    """The row of each unit in units.csv, in the order of the file; messages name the file by `path`.

    Raises:
        MeasurementError: a column, a cell or a row is wrong, or rows and folders do not match.
    """
    header, rows = _rows(decode(raw, path).removeprefix("\ufeff"), path)
    columns = _columns(toml, header, path)
    members: dict[str, Member] = {}
    lines: dict[str, int] = {}
    for line, row in rows.items():
        unit = row[columns["unit"]]
        where = f"{path}:{line}"
        if not unit:
            raise MeasurementError(where, f"{columns['unit']} is empty.", "Every row names its unit.", "Fill it in.")
        if unit in members:
            raise MeasurementError(where, f"unit {unit} has a row already, in line {lines[unit]}.",
                                   "A unit has one row.", "Delete one; repeats of a part are units of their own, "
                                   "with the same `part`.")  # fmt: skip
        if unit not in units:
            raise MeasurementError(where, f"unit {unit} has no folder.", "Each row needs a folder next to this file.",
                                   closest(unit, units, "Delete the row, or put its folder there."))  # fmt: skip
        members[unit], lines[unit] = _member(row, columns, where), line
    if missing := [unit for unit in units if unit not in members]:
        raise MeasurementError(path, f"no row for {first_names(missing, 3)}.", "Each folder has a row.",
                               "Add rows with the folders' names; cells may be empty.")  # fmt: skip
    return members


def _rows(text: str, path: str) -> tuple[list[str], dict[int, dict[str, str]]]:
    """The header, and each row by its line: cells by column, stripped. (pandas silently drops surplus cells.)"""
    reader = csv.reader(io.StringIO(text), delimiter=max(",;\t", key=text.partition("\n")[0].count))
    cells = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    rows = [(number, row) for number, row in cells if any(row)]
    if not rows:
        raise MeasurementError(path, "it is empty.", "A header and a row for each unit are required.",
                               "Write `unit,serial,date`, or delete the file.")  # fmt: skip
    header = rows[0][1]
    if twice := [name for name in header if header.count(name) > 1]:
        raise MeasurementError(f"{path}:1", f"column '{twice[0]}' appears twice.", "Each column needs its own name.",
                               "Rename or delete one.")  # fmt: skip
    for number, row in rows:
        if len(row) != len(header):
            raise MeasurementError(f"{path}:{number}", f"{len(row)} cells.", f"The header has {len(header)}.",
                                   'Correct the row; a text with a comma needs quotes: "a, b".')  # fmt: skip
    return header, {number: dict(zip(header, row, strict=True)) for number, row in rows[1:]}


def _columns(toml: Toml, header: list[str], path: str) -> dict[str, str]:
    """The name of each column in the file, by role; only columns that are there."""
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
