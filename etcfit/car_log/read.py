"""A folder of logs -> DriveLogs: CSV, .msl and .mlg, in the names that ECUs give to position and setpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import MeasurementError
from ..rig.base import RigConfig
from ..rig.columns import Column, read_columns
from ..rig.config import read_config
from ..rig.header import HeaderError, parse_header
from ..rig.mlg import read_mlg
from ..rig.msl import read_msl
from ..rig.names import refuse_foreign_names
from ..rig.table import Table, decode, parse
from .log import DriveLog, Series

READERS: dict[str, Callable[[bytes, str], Table]] = {
    ".csv": lambda raw, where: parse(decode(raw, where), where),
    ".msl": read_msl,
    ".mlg": read_mlg,
}

# what ECUs call them, in small letters; [columns] of rig.toml comes first
KNOWN: dict[str, tuple[str, ...]] = {
    "time": ("time", "timestamp"),
    "position": ("tps", "tp", "tp (main)", "throttle position", "throttle position sensor", "etb position", "tps1"),
    "setpoint": ("etb: position target", "etb position target", "etb target", "etbtarget", "throttle target",
                 "target throttle", "dbw target", "etb setpoint"),
}  # fmt: skip
_UNITS = {"time": "s", "position": "%", "setpoint": "%"}
_SECONDS = {"s", "sec", "secs", "seconds", ""}


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
    if not files:
        raise MeasurementError(str(place), "no log in it.", f"Known: {', '.join(READERS)}.", "Put the logs there.")
    return config, tuple(read_log(path, config, str(toml)) for path in files)


def read_log(path: Path, config: RigConfig, toml: str) -> DriveLog:
    """One log.

    Raises:
        MeasurementError: it cannot be read, or has no time or position.
    """
    table = READERS[path.suffix.casefold()](path.read_bytes(), str(path))
    table = _named(table, config)
    columns = read_columns(table, config, str(path), toml)
    if "position" not in columns:
        raise MeasurementError(str(path), "no position of the plate among its columns.",
                               "A log from the car needs it, in per cent, degrees or sensor volts.",
                               'Name its column in rig.toml: [columns] "TP (Main)" = "position [%]".')  # fmt: skip
    setpoint = columns.get("setpoint")
    return DriveLog(path.name, _series(columns["time"], columns["position"], config, str(path)),
                    None if setpoint is None else _series(columns["time"], setpoint, config, str(path)))  # fmt: skip


def _named(table: Table, config: RigConfig) -> Table:
    """The columns that matter here, by names that `read_columns` knows; an ECU logs hundreds of others."""
    ours: dict[int, str] = {}
    for k, header in enumerate(table.header):
        name = _ours(header, config)
        if name is not None and _quantity(name) not in {_quantity(other) for other in ours.values()}:
            ours[k] = name
    return replace(table, header=tuple(ours.values()), cells=table.cells[:, list(ours)])


def _ours(header: str, config: RigConfig) -> str | None:
    """A header as we write it, where it is one of time, position or setpoint."""
    bare = header.rpartition(" [")[0] or header
    for foreign in (header, bare, header.replace("[", "(").replace("]", ")")):
        if foreign in config.columns:
            name = config.columns[foreign]
            return name if _quantity(name) in KNOWN else None
    if _quantity(header) in KNOWN:
        return header
    quantity = next((q for q, names in KNOWN.items() if bare.casefold() in names), None)
    if quantity is None:
        return None
    unit = header[len(bare) :].strip(" []")
    return f"{quantity} [{_UNITS[quantity] if unit.casefold() in _SECONDS else unit}]"


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
