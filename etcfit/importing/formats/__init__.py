"""Foreign formats: one file each, registered only here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import MeasurementError, require_extra
from ...rig.rows import HUGE
from ..sheet import Sheet
from . import json_log, matlab, mcap, mdf, parquet, servo, tdms, text, wpilog
from .base import Format, Source

FORMATS: tuple[Format, ...] = (
    text.FORMAT,
    matlab.FORMAT,
    mdf.FORMAT,
    tdms.FORMAT,
    parquet.FORMAT,
    mcap.FORMAT,
    text.MEGALOG,
    wpilog.FORMAT,
    json_log.FORMAT,
)
BY_SUFFIX = {suffix: format_ for format_ in FORMATS for suffix in format_.suffixes}
# unpublished formats, and the program that exports them as CSV
CLOSED = {".llg": "PCLink", ".llgx": "PCLink", ".llg5": "PCLink"}


def require_file(path: Path, where: str, required: str) -> None:
    """Refuse a path that is not a file.

    Args:
        where, required: texts of the message.
    Raises:
        MeasurementError: a folder, a pipe or a device, which may never end, or no such file.
    """
    if path.is_dir():
        raise MeasurementError(where, "it is a folder.", required, f"Name the files in it: {where}/*.")
    if path.exists() and not path.is_file():
        raise MeasurementError(where, "it is a pipe or a device.", required,
                               "Write its content to a file, and name that.")  # fmt: skip
    if not path.is_file():
        raise MeasurementError(where, "no such file.", required, "Check the path.")


def closed_error(path: Path, where: str, then: str) -> MeasurementError:
    """The error to raise for a log in one of the formats in CLOSED, with what to do once it is a CSV."""
    program = CLOSED[path.suffix.casefold()]
    return MeasurementError(where, f"a log of {program}, whose format its maker does not publish.",
                            f"Known: {', '.join(BY_SUFFIX)}.",
                            f"Open it in {program}, export it as CSV and {then}.")  # fmt: skip


def require_readable(source: Source) -> None:
    """Refuse a file that cannot be read here, without reading it.

    Raises:
        MeasurementError: no such file, a pipe or a device, an unknown format, or too large a file.
        UsageError: its format needs a library that is not installed.
    """
    require_file(source.path, source.where, "A log or a recording is required.")
    suffix = source.path.suffix.casefold()
    if suffix in CLOSED:
        raise closed_error(source.path, source.where, f"give {source.path.stem}.csv")
    if suffix not in BY_SUFFIX:
        raise MeasurementError(source.where, f"no format is known for '{suffix or source.path.name}'.",
                               f"Known: {', '.join(BY_SUFFIX)}.", "Export it as one of these.")  # fmt: skip
    if library := BY_SUFFIX[suffix].library:
        require_extra("import", source.where, library)
    source.refuse_larger(source.path.stat().st_size)


def read_sheets(source: Source) -> list[Sheet]:
    """Every sheet of a file.

    Raises:
        MeasurementError, UsageError: see `require_readable`.
        MeasurementError: damaged, or without numbers.
    """
    require_readable(source)
    format_ = BY_SUFFIX[source.path.suffix.casefold()]
    sheets = [sheet for sheet in format_.read(source) if sheet.columns]
    if source.servo is not None:
        family = servo.named(source.servo)
        sheets = [each for sheet in sheets for each in servo.decoded(sheet, family)]
    if format_.motors or source.servo is not None or source.motor is not None:
        sheets = _of_one_motor(sheets, source)
    if sheets and max(sheet.rows for sheet in sheets) < 2:
        lacking = "; ".join(dict.fromkeys(each for sheet in sheets for each in sheet.missing))
        raise MeasurementError(source.where, f"{lacking or f'{max(sheet.rows for sheet in sheets)} rows in it'}.",
                               "A trace needs two whole rows or more.",
                               "Record it again, or leave the file out.")  # fmt: skip
    sheets = [_possible(sheet) for sheet in sheets if sheet.rows > 1]
    if not sheets:
        raise MeasurementError(source.where, "no columns of numbers in it.",
                               f"A {format_.name} file with recorded signals is required.",
                               "Export the signals, not only the settings.")  # fmt: skip
    return sheets


def _of_one_motor(sheets: list[Sheet], source: Source) -> list[Sheet]:
    """The sheets of the chosen motor."""
    motors = list(dict.fromkeys(sheet.motor for sheet in sheets))
    if source.motor is None and len(motors) < 2:
        return sheets
    there = ", ".join(f"'{each}'" for each in motors if each) or "one without a name"
    if source.motor is None:
        raise MeasurementError(source.where, f"several motors in it: {there}.", "A rig has one.",
                               f"Name it: --motor '{next(each for each in motors if each)}'.")  # fmt: skip
    if source.motor not in motors:
        raise MeasurementError(source.where, f"no motor '{source.motor}' in it; there are: {there}.", "One of these.",
                               "Correct --motor, or leave it out where there is one.")  # fmt: skip
    return [sheet for sheet in sheets if sheet.motor == source.motor]


def _possible(sheet: Sheet) -> Sheet:
    """The sheet with gaps in place of numbers that are infinite or too large for a reading, and a remark on them."""
    with np.errstate(invalid="ignore"):
        odd = {column.label: np.abs(column.values) > HUGE for column in sheet.columns}
    losses = tuple(
        f"'{label}': {np.sum(at)} numbers that no instrument gives are gaps" for label, at in odd.items() if at.any()
    )
    columns = tuple(replace(each, values=np.where(odd[each.label], np.nan, each.values)) for each in sheet.columns)
    return replace(sheet, columns=columns, losses=(*sheet.losses, *losses)) if losses else sheet
