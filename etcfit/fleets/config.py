"""fleet.toml and units.csv -> FleetConfig: every key checked, every value in SI. Both files may be missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ..rig.config import RIG_KEYS, TABLES, TPS_KEYS, config_of
from ..rig.table import decode
from ..rig.toml import Toml, parse, shown
from ..rig.units import UnitError, to_si
from .folder import is_url, text_of, units_of
from .members import Member, read_members

FLEET_KEYS = ("name", "shared", "units")
LIMIT_KEYS = ("low", "high", "unit")
UNITS_FILE = "units.csv"


@dataclass(frozen=True)
class Limit:
    """What a specification allows.

    Args:
        low, high: SI; -inf and inf where a side is open.
        unit: SI, as pint writes it.
        given: unit that the file has.
    """

    low: float
    high: float
    unit: str
    given: str


@dataclass(frozen=True)
class FleetConfig:
    """What is written down about a fleet.

    Args:
        name: of the fleet.
        location: its folder or address, as given.
        shared: symbols that have one value for all units.
        limits: by symbol, or by figure of the line.
        members: by unit, all of them, in the order of units.csv, else by name.
        common: what their rigs have in common: the tables of a rig.toml.
    """

    name: str
    location: str
    shared: tuple[str, ...]
    limits: Mapping[str, Limit]
    members: Mapping[str, Member]
    common: Toml

    @property
    def units(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(self.members)


def read_fleet(location: str | Path) -> FleetConfig:
    """Read and check what a fleet's folder says about its units, but none of their measurements.

    Args:
        location: a folder, or an address that fsspec opens.

    Raises:
        MeasurementError: there is no unit, or fleet.toml or units.csv is wrong.
    """
    base = str(location).rstrip("/") or str(location)
    units = units_of(location)
    toml = _fleet_toml(location, f"{base}/fleet.toml")
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


def _fleet_toml(location: str | Path, path: str) -> Toml:
    raw = text_of(location, "fleet.toml")
    text = "" if raw is None else decode(raw, path).removeprefix("\ufeff")
    return Toml(path, text, parse(text, path))


def _name(toml: Toml, fleet: Mapping[str, Any], base: str) -> str:
    if "name" in fleet and "name" in toml.tables:
        raise toml.wrong("name", "found beside [fleet] name.", "A fleet has one name.", "Delete one.")
    if "name" in fleet:
        return toml.string("fleet.name", fleet["name"])
    default = PurePosixPath(base).name if is_url(base) else Path(base).absolute().name
    return toml.string("name", toml.tables.get("name", default))


def _shared(toml: Toml, fleet: Mapping[str, Any]) -> tuple[str, ...]:
    values = fleet.get("shared", [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise toml.wrong("fleet.shared", f"found {shown(values)}.", "It must be a list of symbols.",
                         'Write shared = ["K_b"].')  # fmt: skip
    return tuple(dict.fromkeys(values))


def _limit(toml: Toml, name: str, value: Any) -> Limit:
    key = f"limits.{name}"
    if not isinstance(value, dict) or "unit" not in value or not {"low", "high"} & set(value):
        raise toml.wrong(key, f"found {shown(value)}.", "It must name a unit, and low or high or both.",
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
        return read_members(raw, f"{base}/{name}", toml, units)
    if "units" in fleet:
        raise toml.wrong("fleet.units", f"found '{name}', which is not there.", "It is a CSV beside fleet.toml.",
                         "Correct the name, or delete the line.")  # fmt: skip
    if "units" in toml.tables:
        raise toml.wrong("units", f"columns of {name}, which is not there.", "It is a CSV beside fleet.toml.",
                         "Put it there, or delete the table.")  # fmt: skip
    return dict.fromkeys(units, Member())


def _common(toml: Toml) -> Toml:
    """The tables of a rig.toml in it, once they are right in themselves; a unit's own may complete them."""
    rig = toml.table("rig", RIG_KEYS)
    if "name" in rig:
        raise toml.wrong("rig.name", f"found {shown(rig['name'])}.", "In fleet.toml it would be that of every unit.",
                         "Write [fleet] name for the fleet's, and [rig] name in a unit's own rig.toml.")  # fmt: skip
    common = Toml(toml.path, toml.source, {name: toml.tables[name] for name in TABLES if name in toml.tables}, (toml,))
    whole = set(TPS_KEYS) <= set(common.table("tps", TPS_KEYS)) or "tps" not in common.tables
    alone = common.tables if whole else {name: common.tables[name] for name in common.tables if name not in _OF_TPS}
    config_of(Toml(common.path, common.source, alone), "fleet")
    return common


_OF_TPS = ("tps", "noise", "accuracy")  # cannot be checked before a unit has said the rest of [tps]
