"""Reads a folder of logs as DriveLogs: every format of `etcfit import`, with the column names that it uses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..errors import MeasurementError, UsageError
from ..importing.answers import IGNORE, Answers, target
from ..importing.formats import BY_SUFFIX, CLOSED, closed_error, read_sheets
from ..importing.formats.base import Source
from ..importing.names import is_about, is_engines, is_plates, known, quantity_named
from ..importing.quantities import one_each, quantity_of, take_by_itself
from ..importing.sheet import TIME, Column, Sheet
from ..importing.take import LEFT_OUT, Take, signed, time_of
from ..rig.base import RigConfig
from ..rig.config import read_config
from ..rig.units import UnitError, to_channel
from ..rig.user_text import refuse_foreign_names, toml_string
from . import others
from .log import DriveLog, Series

_TARGETS = ("target", "setpoint", "demand", "desired", "request", "aim", "soll")  # words in headers of a setpoint
_OPTION = re.compile(r"(?:--column )?'(?P<header>[^'=]+)=(?P<wanted>[^']+)'")
_PLATE = ("position", "tps")
_ANY_TEXT = (".txt", ".asc", ".dat", ".log", ".json")  # suffixes of files that need not be logs
_MOST = 60  # most names that a message lists


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
    files = sorted(p for p in place.iterdir() if _is_log(p))
    files = [p for p in files if p.suffix.casefold() not in _ANY_TEXT or _has_rows(p)] or files
    refuse_foreign_names(str(place), *(path.name for path in files))
    _refuse_closed(place, {path.stem for path in files})
    if not files:
        raise MeasurementError(str(place), "no log in it.", f"Known: {', '.join(BY_SUFFIX)}.", "Put the logs there.")
    return config, tuple(read_log(path, config, str(toml)) for path in files)


def logs_at(place: Path | str) -> tuple[RigConfig, tuple[DriveLog, ...]]:
    """The logs of a folder (see `read_logs`), or one log; rig.toml is in its folder, or above drive/.

    Raises:
        MeasurementError: no log, or one without position or time.
    """
    path = Path(place)
    if not path.is_file():
        return read_logs(path)
    folder = path.absolute().parent
    toml = (folder.parent if folder.name == "drive" else folder) / "rig.toml"
    config = read_config(toml) if toml.is_file() else RigConfig(name=path.stem)
    return config, (read_log(path, config, str(toml)),)


def _has_rows(path: Path) -> bool:
    """Whether a text has rows of numbers; notes among the logs have none."""
    try:
        return bool(read_sheets(Source(path, str(path))))
    except MeasurementError:
        return False


def _is_log(path: Path) -> bool:
    plain = not path.name.startswith(".") and path.stem.casefold() != "readme"
    return plain and path.suffix.casefold() in BY_SUFFIX and not path.is_dir()


def _refuse_closed(place: Path, known: AbstractSet[str]) -> None:
    """Refuse logs in an unpublished format, unless a readable log of the same name is there.

    What others found of Link's format (UltraLog, oecua.org: "lf3" at byte 4, names in UTF-16) describes neither the
    data between its blocks nor the differences of its versions; we have no such file to test a reader with.
    """
    for path in sorted(place.iterdir()):
        if path.suffix.casefold() in CLOSED and path.stem not in known:
            raise closed_error(path, str(path), f"put {path.stem}.csv there")


def read_log(path: Path, config: RigConfig, toml: str) -> DriveLog:
    """Read one log.

    Raises:
        MeasurementError: it cannot be read, or has no time or position.
    """
    answers = _answers(config.columns, toml)
    sheets = read_sheets(Source(path, str(path)))
    with _cures_of_toml():
        found = [(sheet, _takes(sheet, answers, _raw_volts(sheet, config))) for sheet in sheets]
    having = [(sheet, takes) for sheet, takes in found if any(name in takes for name in _PLATE)]
    volts = [(sheet, takes) for sheet, takes in found if others.VOLTS_1 in others.found(_headers(sheet))]
    if not having and not volts:
        raise _without_plate(str(path), sheets)
    sheet, takes = max(having or volts, key=lambda each: ("setpoint" in each[1], each[0].rows))
    with _cures_of_toml():
        time = time_of(sheet, answers)
    plate = takes.get("position") or takes.get("tps")
    series = {name: _series(time, take, config, sheet.where)
              for name, take in (("position", plate), ("setpoint", takes.get("setpoint"))) if take}  # fmt: skip
    headers = _headers(sheet)
    places = others.found(headers)
    along = others.series(time.si, [column.values for column in sheet.columns], places)
    beside = {name: headers[places[name][0]] for name in along}
    if plate is None and others.VOLTS_1 in along:
        # a log of the sensors' voltages without a position: the first one's voltage over its own range is the position
        first = along[others.VOLTS_1]
        shown = 100.0 * (first.value - first.value.min()) / max(float(np.ptp(first.value)), 1e-9)
        hint = "No position in %: the first sensor's voltage is shown between its least and its highest value."
        return DriveLog(path.name, Series(first.time, shown), series.get("setpoint"), beside, hint, along)
    if plate is None:
        raise _without_plate(str(path), sheets)
    written = {"time": time.column.label, "position": _shown(plate.column),
               **({"setpoint": _shown(takes["setpoint"].column)} if "setpoint" in takes else {})}  # fmt: skip
    hints = ("" if "setpoint" in takes else _of_setpoint(sheet), _of_unit(plate, sheet),
             *(f"{each[0].upper()}{each[1:]}." for each in (*sheet.losses, *sheet.missing)))  # fmt: skip
    ends = None if config.tps is None else (config.tps.closed_V, config.tps.open_V)
    return DriveLog(path.name, series["position"], series.get("setpoint"), written | beside,
                    " ".join(filter(None, hints)), along, ends)  # fmt: skip


def _headers(sheet: Sheet) -> list[str]:
    return [_shown(column) for column in sheet.columns]


def _raw_volts(sheet: Sheet, config: RigConfig) -> frozenset[int]:
    """Columns of sensor voltages that are not read as the position; with [tps] of rig.toml the first one is."""
    names = () if config.tps else (others.VOLTS_1, others.VOLTS_2)
    return frozenset(place for name, (place, _) in others.found(_headers(sheet)).items() if name in names)


def _answers(columns: Mapping[str, str], toml: str) -> Answers:
    """The column names in [columns] of rig.toml.

    Raises:
        MeasurementError: one of them is no header of a measurement folder.
    """
    try:
        return Answers({("", name): target(wanted, f"[columns] {name}") for name, wanted in columns.items()})
    except UsageError as err:
        raise MeasurementError(toml, f"{err}", "Headers of a measurement folder are required.",
                               'Write "TP (Main)" = "position [%]".') from err  # fmt: skip


def _takes(sheet: Sheet, answers: Answers, without: AbstractSet[int]) -> dict[str, Take]:
    """The columns of position and setpoint, by quantity; an ECU logs hundreds of others."""
    columns = [column for k, column in enumerate(sheet.columns) if k not in without]
    takes = [take_by_itself(column, sheet, answers) for column in columns if _matters(column, sheet, answers)]
    kept = one_each([take for take in takes if take is not None], answers, sheet)
    return {take.quantity: signed(take) for take in map(_of_car, kept) if take.quantity != LEFT_OUT}


def _matters(column: Column, sheet: Sheet, answers: Answers) -> bool:
    said = answers.wanted(sheet.file, column)
    quantity = quantity_of(column, sheet) if said is None else said.quantity
    return quantity in (*_PLATE, "setpoint") and quantity != IGNORE


def _of_car(take: Take) -> Take:
    """A column of a car log: a position without a unit is in per cent, whatever its size."""
    said = take.said or take.column.unit
    return take if said or take.quantity not in (*_PLATE, "setpoint") else Take(
        take.column, "setpoint" if take.quantity == "setpoint" else "position", "%", take.reason)  # fmt: skip


@contextmanager
def _cures_of_toml() -> Iterator[None]:
    """Replace the option of `etcfit import`, which errors of guessing name, by the line of rig.toml that serves
    here."""
    try:
        yield
    except MeasurementError as err:
        mend = _OPTION.sub(
            lambda m: f"[columns] {toml_string(m['header'])} = {toml_string(m['wanted'])} in rig.toml", err.mend
        )
        raise MeasurementError(err.where, err.found, err.required, mend) from err


def _without_plate(where: str, sheets: Sequence[Sheet]) -> MeasurementError:
    columns = [column for sheet in sheets for column in sheet.columns]
    # columns with a word of the plate first, the time last
    like = sorted(columns, key=lambda c: (quantity_named(c.name) == TIME, is_engines(c.name) or not is_plates(c.name)))
    there = ", ".join(f"'{_shown(column)}'" for column in like[:_MOST])
    more = f" and {len(like) - _MOST} others" if len(like) > _MOST else ""
    example = _shown(like[0]) if like else "TP (Main)"
    return MeasurementError(where, f"no position of the plate among its columns {there}{more}.",
                            "A log from the car needs it, in per cent, degrees or sensor volts.",
                            f'Name its column in rig.toml: [columns] {toml_string(example)} = "position [%]".'
                            )  # fmt: skip


def _shown(column: Column) -> str:
    """A column with its unit, if the file gives it."""
    unit = column.unit or column.stated
    return f"{column.label} [{unit}]" if unit and column.label == column.name else column.label


def _of_setpoint(sheet: Sheet) -> str:
    """How to name the setpoint where no column is known to be it."""
    like = [_shown(c) for c in sheet.columns
            if any(word in c.name.casefold() for word in _TARGETS)
            and not c.stated and not is_engines(c.name) and not is_about(c.name)]  # fmt: skip
    there = f"Columns that may be it: {', '.join(like[:_MOST])}. " if like else "No column looks like it. "
    example = like[0] if like else "TP Target"
    return f'No setpoint was found. {there}Name it in rig.toml: [columns] {toml_string(example)} = "setpoint [%]".'


def _of_unit(plate: Take, sheet: Sheet) -> str:
    """A remark that a position without a unit is taken as per cent; none for logs of ECUs, whose positions are per
    cent."""
    if plate.said or plate.column.unit or sheet.is_ecu or known(plate.column.name):
        return ""
    label = plate.column.label
    return (f"'{label}' has no unit and is taken as per cent of the travel. If it is in degrees, say so in rig.toml: "
            f'[columns] {toml_string(label)} = "position [deg]".')  # fmt: skip


def _series(time: Take, take: Take, config: RigConfig, where: str) -> Series:
    """A column in per cent of the travel, see `Series.rising`."""
    low, high = config.travel
    try:
        conversion = to_channel(take.quantity, take.unit, config.travel, config.tps)[1]
    except UnitError as err:
        raise MeasurementError(where, f"column '{take.column.label}': {err}", "The rig.toml must say how to read it.",
                               "Add [tps] with closed_V, open_V, travel_deg, or both ends in [rig] travel_deg."
                               ) from err  # fmt: skip
    logged = conversion.scale * take.column.values + conversion.offset
    series = Series.rising(time.si, 100.0 * (logged - low) / (high - low))
    if series.time.size < 2:
        raise MeasurementError(where, f"column '{take.column.label}' holds {series.time.size} sample.", "At least two.",
                               "Log it again.")  # fmt: skip
    return series
