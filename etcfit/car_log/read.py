"""A folder of logs -> DriveLogs: CSV, .msl and .mlg, in the names that ECUs give to position and setpoint."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import MeasurementError
from ..files import read_regular
from ..rig.base import RigConfig
from ..rig.columns import Column, read_columns
from ..rig.comments import toml_string
from ..rig.config import read_config
from ..rig.header import HeaderError, parse_header
from ..rig.mlg import read_mlg
from ..rig.msl import read_msl
from ..rig.names import refuse_foreign_names
from ..rig.table import Table, decode, parse
from ..rig.toml import Toml, read_text
from . import others
from .ecu_csv import plain
from .log import DriveLog, Series

READERS: dict[str, Callable[[bytes, str], Table]] = {
    ".csv": lambda raw, where: parse(plain(decode(raw, where)), where),
    ".msl": read_msl,
    ".mlg": read_mlg,
}

CLOSED = {".llg": "PCLink", ".llgx": "PCLink"}  # formats that no maker publishes, and the program that writes a CSV

# what ECUs call them, in small letters, the surest first; [columns] of rig.toml comes before all
KNOWN: dict[str, tuple[str, ...]] = {
    "time": ("time", "timestamp"),
    # "TPS" last: beside a name of the plate's own it is the pedal (MaxxECU)
    "position": ("etb position", "e-throttle position", "throttle position", "throttle position sensor",
                 "tp (main)", "tps (main)", "tp", "tps1", "tps"),
    "setpoint": ("etb: position target", "etb position target", "etb target", "etbtarget", "etb setpoint",
                 "e-throttle target", "dbw throttle target position", "dbw target", "throttle target",
                 "target throttle", "throttle position target", "tp target", "tps target"),
}  # fmt: skip
_TARGETS = ("target", "setpoint", "demand", "desired", "request")  # words of what may be a setpoint
_PLATE = re.compile(r"(throttle|etb|dbw)\b.*\bpos", re.IGNORECASE)  # of what may be the plate's position
_TPS = re.compile(r"tps1?\s*([\[(].*[\])])?", re.IGNORECASE)
_UNITS = {"time": "s", "position": "%", "setpoint": "%"}
_SECONDS = {"s", "sec", "secs", "seconds", ""}
_UNIT = re.compile(r"(?P<bare>.+?)\s*[\[(](?P<unit>s|sec|secs|seconds|ms|%|deg|V|rad)[\])]\s*", re.IGNORECASE)


def read_logs(folder: Path | str) -> tuple[RigConfig, tuple[DriveLog, ...]]:
    """Every log in FOLDER/drive, or in FOLDER itself where there is no such folder, in order of file name.

    Args:
        folder: a measurement folder, or any folder of logs; its rig.toml may be missing.
    Raises:
        MeasurementError: no log, or one without position or time.
    """
    base = Path(folder)
    toml = base / "rig.toml"
    config = read_config(toml) if toml.is_file() else RigConfig(name=base.absolute().name)
    place = base / "drive" if (base / "drive").is_dir() else base
    files = sorted(p for p in place.iterdir() if p.suffix.casefold() in READERS and not p.name.startswith("."))
    refuse_foreign_names(str(place), *(path.name for path in files))
    _refuse_closed(place, {path.stem for path in files})
    if not files:
        raise MeasurementError(str(place), "no log in it.", f"Known: {', '.join(READERS)}.", "Put the logs there.")
    return config, tuple(read_log(path, config, str(toml)) for path in files)


def _refuse_closed(place: Path, known: AbstractSet[str]) -> None:
    """Logs in a format that nobody publishes, unless one that can be read lies there by the same name.

    What others found out of Link's (UltraLog, oecua.org: "lf3" at byte 4, names in UTF-16) says neither what lies
    between its blocks nor what its versions differ in; we have no such file to hold a reader to.
    """
    for path in sorted(place.iterdir()):
        program = CLOSED.get(path.suffix.casefold())
        if program is not None and path.stem not in known:
            unread = f"a log of {program}, whose format its maker does not publish."
            cure = f"Open it in {program}, export it as CSV and put {path.stem}.csv there."
            raise MeasurementError(str(path), unread, f"Known: {', '.join(READERS)}.", cure)


def read_log(path: Path, config: RigConfig, toml: str) -> DriveLog:
    """One log.

    Raises:
        MeasurementError: it cannot be read, or has no time or position.
    """
    whole = READERS[path.suffix.casefold()](read_regular(path, str(path)), str(path))
    places = others.found(whole.header)
    raw = () if config.tps else (others.VOLTS_1, others.VOLTS_2)  # [tps] makes the position of the first one's volts
    volts = {place for name, (place, _) in places.items() if name in raw}
    taken = _taken(whole, config, volts)
    table = replace(whole, header=tuple(taken.values()), cells=whole.cells[:, list(taken)])
    named = Toml(toml, read_text(toml) if Path(toml).is_file() else "", {})  # for messages alone
    columns = read_columns(table, config, str(path), named)
    along = others.series(columns["time"].value, list(whole.cells.T), places)
    setpoint = columns.get("setpoint")
    asked = None if setpoint is None else _series(columns["time"], setpoint, config, str(path))
    if "position" not in columns and others.VOLTS_1 in along:
        return _sweep(path.name, asked, along, {name: whole.header[place] for name, (place, _) in places.items()})
    if "position" not in columns:
        raise MeasurementError(str(path), "no position of the plate among its columns.",
                               "A log from the car needs it, in per cent, degrees or sensor volts.",
                               'Name its column in rig.toml: [columns] "TP (Main)" = "position [%]".')  # fmt: skip
    written = {str(_quantity(name)): whole.header[k] for k, name in taken.items()}
    hints = (_of_position(written["position"], whole.header), "" if setpoint else _of_setpoint(whole.header),
             *(f"{each[0].upper()}{each[1:]}." for each in whole.losses))  # fmt: skip
    return DriveLog(path.name, _series(columns["time"], columns["position"], config, str(path)),
                    asked, written | {name: whole.header[places[name][0]] for name in along},
                    " ".join(filter(None, hints)), along, _ends(config))  # fmt: skip


def _ends(config: RigConfig) -> tuple[float, float] | None:
    return None if config.tps is None else (config.tps.closed_V, config.tps.open_V)


def _sweep(name: str, asked: Series | None, along: Mapping[str, Series], written: Mapping[str, str]) -> DriveLog:
    """A log of the sensors' volts without a position: it is the first one's voltage between its own ends."""
    first = along[others.VOLTS_1]
    shown = 100.0 * (first.value - first.value.min()) / max(float(np.ptp(first.value)), 1e-9)
    hint = "No position in %: the first sensor's voltage is shown between its least and its highest value."
    return DriveLog(name, Series(first.time, shown), asked, dict(written), hint, along)


def _may_be_target(name: str) -> bool:
    return any(word in name.casefold() for word in _TARGETS)


def _of_setpoint(header: Sequence[str]) -> str:
    """How to name the setpoint among columns of which none is known to be it."""
    like = [name for name in header if _may_be_target(name)]
    there = f"Columns that may be it: {', '.join(like)}. " if like else "No column looks like it. "
    example = like[0] if like else "TP Target"
    return f'No setpoint was found. {there}Name it in rig.toml: [columns] {toml_string(example)} = "setpoint [%]".'


def _of_position(taken: str, header: Sequence[str]) -> str:
    """How to name the plate where what was taken for it may be the pedal."""
    like = [name for name in header if _PLATE.search(name) and not _may_be_target(name)]
    if not (_TPS.fullmatch(taken) and like):
        return ""
    return (f"'{taken}' was taken for the plate; in some ECUs (MaxxECU) it is the pedal. Columns that may be the "
            f"plate: {', '.join(like)}. "
            f'Name it in rig.toml: [columns] {toml_string(like[0])} = "position [%]".')  # fmt: skip


def _taken(table: Table, config: RigConfig, without: AbstractSet[int] = frozenset()) -> dict[int, str]:
    """Places of the columns that matter here, and names that `read_columns` knows; an ECU logs hundreds of others.

    Of several for one quantity the one by the surest name, then the first.
    """
    best: dict[str, tuple[int, int, str]] = {}
    for k, header in enumerate(table.header):
        found = None if k in without else _ours(header, config)
        if found is None:
            continue
        name, rank = found
        quantity = str(_quantity(name))
        best[quantity] = min(best.get(quantity, (rank, k, name)), (rank, k, name))
    return {k: name for _, k, name in sorted(best.values(), key=lambda each: each[1])}


def _ours(header: str, config: RigConfig) -> tuple[str, int] | None:
    """A header as we write it, where it is one of time, position or setpoint, and how sure that is, 0 the surest."""
    match = _UNIT.fullmatch(header)
    bare = match["bare"] if match else header.rpartition(" [")[0] or header
    for foreign in (header, bare, header.replace("[", "(").replace("]", ")")):
        if foreign in config.columns:
            name = config.columns[foreign]
            return (name, 0) if _quantity(name) in KNOWN else None
    if _quantity(header) in KNOWN:
        return header, 0
    quantity = next((q for q, names in KNOWN.items() if bare.casefold() in names), None)
    if quantity is None:
        return None
    unit = match["unit"] if match else header[len(bare) :].strip(" []")
    told = _UNITS[quantity] if unit.casefold() in _SECONDS else unit
    return f"{quantity} [{told}]", 1 + KNOWN[quantity].index(bare.casefold())


def _quantity(header: str) -> str | None:
    try:
        quantity = parse_header(header)[0]
    except HeaderError:
        return None
    return "position" if quantity == "tps" else quantity


def _series(time: Column, column: Column, config: RigConfig, where: str) -> Series:
    """Where both were logged and time goes on: an ECU may write several rows a tick of its clock."""
    low, high = config.travel
    there = np.isfinite(time.value) & np.isfinite(column.value)
    t, value = time.value[there], 100.0 * (column.value[there] - low) / (high - low)
    ahead = t > np.concatenate(([-np.inf], np.maximum.accumulate(t)[:-1]))
    if ahead.sum() < 2:
        raise MeasurementError(where, f"column '{column.header}' holds {int(ahead.sum())} sample.", "At least two.",
                               "Log it again.")  # fmt: skip
    return Series(t[ahead], value[ahead])
