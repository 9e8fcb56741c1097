"""Reads a measurement folder as a Rig; all input of measurements goes through here."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from ..errors import MeasurementError
from ..files import digest, read_regular
from . import TESTS
from .base import Channel, Measurement, Rig, RigConfig
from .checks import findings
from .columns import DROP, Column, Log, read_columns, with_motor_current
from .config import config_of
from .duplicates import refuse_duplicates
from .noise import Texture, pooled, textures
from .sanity import check_log, check_peaks
from .table import Table, decode, parse
from .toml import Toml, closest, read_text, written
from .toml import parse as parse_toml
from .user_text import refuse_foreign_names

# rig test -> groups of channels; a trace needs one channel of each group
KNOWN_TESTS: dict[str, tuple[tuple[str, ...], ...]] = {test.name: test.needs for test in TESTS}
_LINES_ABOVE = 50  # lines with which a last line without an end is compared


def read_folder(folder: str | Path, common: Toml | None = None) -> Rig:
    """Read a measurement folder: rig.toml and every CSV in the folders of known rig tests.

    Args:
        folder: as the user gave it; every message names files below it in the same way.
        common: tables that hold for all units of a fleet; the folder's own rig.toml overrides them and may be missing.

    Raises:
        MeasurementError: anything in it is wrong.
    """
    base = str(folder).rstrip("/\\") or str(folder)
    refuse_foreign_names(base)
    refuse_foreign_names(Path(folder).absolute().name)  # the name of a rig without a name in rig.toml
    if not Path(folder).is_dir():
        raise MeasurementError(base, "no such folder.", "A measurement folder with a rig.toml is required.",
                               "Check the path.")  # fmt: skip
    toml = rig_toml(base, common)
    config = config_of(toml, Path(folder).absolute().name)
    files, odd = _csv_files(Path(folder), base)
    config = checked(config, files, toml)
    rig = assembled(base, config, [_read_log(base, file, config, toml) for file in files], odd, toml)
    return replace(rig, digests=_digests(Path(folder), files))


def rig_toml(base: str, common: Toml | None = None) -> Toml:
    """The tables of a folder's rig.toml, merged over common tables.

    Args:
        common: common tables, with which the folder needs no rig.toml; None: there are none.

    Raises:
        MeasurementError: it cannot be read, or is no TOML.
    """
    path = f"{base}/rig.toml"
    if common is not None and not Path(path).exists():
        return replace(common, layers=(common,))
    text = read_text(path)
    own = Toml(path, text, parse_toml(text, path))
    return own if common is None else own.over(common)


def digests_of(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a measurement folder that `read_folder` would read now.

    Raises:
        MeasurementError: there is no trace in it.
    """
    files, _ = _csv_files(folder, str(folder))
    return _digests(folder, files)


def _digests(folder: Path, files: Iterable[str]) -> dict[str, str]:
    return {file: digest(folder / file) for file in ("rig.toml", *files) if (folder / file).is_file()}


def checked(config: RigConfig, files: Iterable[str], toml: Toml) -> RigConfig:
    """The config, after a check that it names only tests and traces that exist.

    Raises:
        MeasurementError: an unknown test, or a held-out trace that is not there.
    """
    for test in config.series_ohm:
        if test not in KNOWN_TESTS:
            raise toml.wrong(f"tests.{test}", "no such rig test.", f"Known: {', '.join(KNOWN_TESTS)}.",
                             closest(test, KNOWN_TESTS, "Delete the table."))  # fmt: skip
    files = tuple(files)
    for name in config.holdout:
        if name not in files:
            raise MeasurementError(toml.place("holdout.files"),
                                   f"holdout.files names '{name}', which is not there.",
                                   "Held-out files are given relative to the folder, as 'response/1.csv'.",
                                   closest(name, files, "Correct the name, or remove it."))  # fmt: skip
    return replace(config, holdout=tuple(dict.fromkeys(config.holdout)))


def assembled(
    folder: str, config: RigConfig, read: Sequence[tuple[Log, list[str]]], odd: Iterable[str], toml: Toml
) -> Rig:
    """The rig of these logs.

    Args:
        read: each log, and warnings about it.

    Raises:
        MeasurementError: the logs of a test are impossible together, or one record is there twice.
    """
    logs = tuple(log for log, _ in read)
    for test in KNOWN_TESTS:
        check_peaks(test, [log for log in logs if log.test == test])
    twice = refuse_duplicates(logs)
    used = {" ".join(c.header.split()) for log in logs for c in log.columns.values()}
    unused = [f'{toml.place(f"columns.{name}")}: [columns] names "{name}", which no CSV has.'
              for name, ours in config.columns.items() if name not in used and ours.casefold() not in DROP]  # fmt: skip
    warnings = [*odd, *(w for _, ws in read for w in ws), *unused, *twice]
    measurements = _measurements(logs, config)
    found = findings(config, measurements)
    return Rig(folder, config, measurements, (*warnings, *map(str, found)), written(toml), findings=found)


def _csv_files(folder: Path, base: str) -> tuple[list[str], list[str]]:
    """CSVs of known tests, relative to the folder and in order; warnings about all others."""
    files: list[str] = []
    odd: list[str] = []
    empty: list[str] = []
    for place in sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")):
        inside = sorted(p.name for p in place.iterdir() if _is_csv(p))
        refuse_foreign_names(base, place.name, *(f"{place.name}/{name}" for name in inside))
        if place.name in KNOWN_TESTS:
            files += [f"{place.name}/{name}" for name in inside]
            empty += [] if inside else [place.name]
        elif inside:
            odd.append(f"{base}/{place.name}: no known rig test, its {len(inside)} CSV are not read. "
                       f"{closest(place.name, KNOWN_TESTS, 'Known: ' + ', '.join(KNOWN_TESTS) + '.')}")  # fmt: skip
    if empty:
        odd.append(f"{base}: no CSV in {', '.join(empty)}. Add traces, or delete the empty folders.")
    loose = sorted(p.name for p in folder.iterdir() if _is_csv(p))
    refuse_foreign_names(base, *loose)
    odd += [f"{base}/{name}: not in a folder of a rig test, not read." for name in loose]
    if not files:
        raise MeasurementError(base, "no CSV of a known rig test in it.", f"Known: {', '.join(KNOWN_TESTS)}.",
                               " ".join(["Put each trace into a folder named after its test.", *odd]))  # fmt: skip
    return files, odd


def _is_csv(path: Path) -> bool:
    return path.suffix.casefold() == ".csv" and not path.name.startswith((".", "~")) and not path.is_dir()


def _read_log(base: str, file: str, config: RigConfig, toml: Toml) -> tuple[Log, list[str]]:
    """One CSV, checked; and warnings about columns without any number."""
    where = f"{base}/{file}"
    try:
        raw = read_regular(Path(where), where)
    except OSError as err:
        raise MeasurementError(where, f"cannot be read ({err.strerror}).", "It must be a readable file.",
                               "Check its permissions.") from err  # fmt: skip
    text = decode(raw, where)
    log, odd = log_of(parse(text, where), where, file, config, toml)
    if not text.endswith("\n"):  # digits may be lost where the last cell is shorter than all above
        *above, last = (re.split(r"[,;\t]", line)[-1].strip() for line in text.split("\n")[-_LINES_ABOVE:])
        if last and len(above) >= 3 and len(last) < min(map(len, above)):
            odd.append(f"{where}: the last line has no end, and its last number, {last}, is shorter than those above: "
                       "the file may be cut off. Copy it again, or delete the line.")  # fmt: skip
    return log, odd


def log_of(table: Table, where: str, file: str, config: RigConfig, toml: Toml) -> tuple[Log, list[str]]:
    """A table as the log of a rig test, checked; and warnings about columns without any number.

    Args:
        file: `<test>/<name>`.

    Raises:
        MeasurementError: a column, a row or the whole trace is impossible.
    """
    columns = with_motor_current(read_columns(table, config, where, toml), config, where)
    empty = [name for name, column in columns.items() if np.isnan(column.logged).all() and name != "time"]
    log = Log(where, file, PurePosixPath(file).parts[0], table.lines,
              {name: column for name, column in columns.items() if name not in empty}, table.row_mark)  # fmt: skip
    _check_rows(log)
    for group in KNOWN_TESTS[log.test]:
        if not set(group) & set(log.channels):
            raise MeasurementError(where, f"no {' or '.join(group)} among {', '.join(log.channels) or 'nothing'}.",
                                   f"A {log.test} trace needs it.",
                                   "Add the column, map its header under [columns], "
                                   "or move the file to the folder of its test.")  # fmt: skip
    only_duty = "duty" in log.channels and not {"voltage", "supply", "torque"} & set(log.channels)
    if only_duty and config.supply_V is None:
        raise MeasurementError(where, "duty without voltage or supply.", "Voltage is duty times supply.",
                               "Add a 'supply [V]' column, or [rig] supply_V in rig.toml.")  # fmt: skip
    check_log(log, config)
    return log, [f"{where}: column '{columns[name].header}' holds no number and is left out." for name in empty]


def _check_rows(log: Log) -> None:
    """Time in every row, rising strictly; two rows at least."""
    column = log.columns["time"]
    if len(log.lines) < 2:
        raise MeasurementError(log.where, f"{len(log.lines)} sample in the file.", "A trace needs two or more.",
                               "Log it again, or delete the file.")  # fmt: skip
    missing = np.isnan(column.logged)
    if missing.any():
        raise MeasurementError(log.at(int(np.argmax(missing))), "time is empty.",
                               "Every row needs its time.", "Fill it in, or delete the row.")  # fmt: skip
    falls = np.diff(column.value) <= 0
    if falls.any():
        k = int(np.argmax(falls))
        before, after = (f"{t:.12g}" for t in column.logged[k : k + 2])
        found = f"time stays at {before}" if before == after else f"time falls from {before} to {after}"
        raise MeasurementError(log.at(k + 1), f"{found} {column.unit}.",
                               "Time must rise strictly;", "sort the log or split it.")  # fmt: skip


def _measurements(logs: tuple[Log, ...], config: RigConfig) -> tuple[Measurement, ...]:
    """Every channel with its noise: given, or pooled over the traces logged under the same header."""
    bare: list[Measurement] = []
    looks: dict[tuple[str, str], Texture] = {}
    for log in logs:
        time = _frozen(log.time)
        channels = {name: _channel(column, time) for name, column in log.channels.items()}
        bare.append(Measurement(log.file, log.test, time, channels, log.file in config.holdout))
        together: dict[bytes, list[str]] = {}  # channels logged at the same instants are evaluated together
        for name, channel in channels.items():
            together.setdefault(channel.time.tobytes(), []).append(name)
        for names in together.values():
            found = textures(channels[names[0]].time, [channels[name].value for name in names])
            looks |= {(log.file, name): look for name, look in zip(names, found, strict=True)}

    def with_noise(trace: Measurement, name: str, channel: Channel) -> Channel:
        same = [m for m in bare if name in m.channels and m.channels[name].header == channel.header]
        own = [looks[m.file, name] for m in same if m.test == trace.test]
        sigma, quantum = pooled(own, [looks[m.file, name] for m in same])
        given = config.noise.get(name)
        return replace(channel, sigma=sigma if given is None else given, sigma_estimated=given is None, quantum=quantum)

    return tuple(
        replace(m, channels={name: with_noise(m, name, channel) for name, channel in m.channels.items()}) for m in bare
    )


def _channel(column: Column, time: np.ndarray) -> Channel:
    """The channel of a column; channels without empty cells share one time array."""
    value, there = column.value, ~np.isnan(column.logged)
    if not there.all():
        time, value = _frozen(time[there]), value[there]
    return Channel(time, _frozen(value), np.nan, True, column.header, column.unit, column.conversion.scale,
                   offset=column.conversion.offset)  # fmt: skip


def _frozen(array: np.ndarray) -> np.ndarray:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
