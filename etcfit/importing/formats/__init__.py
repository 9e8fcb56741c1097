"""Foreign formats: one file each, registered here and nowhere else."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import MeasurementError
from ..sheet import Sheet
from . import matlab, mcap, mdf, megalog, parquet, tdms, text
from .base import Format, Source, library

FORMATS: tuple[Format, ...] = (
    text.FORMAT,
    matlab.FORMAT,
    mdf.FORMAT,
    tdms.FORMAT,
    parquet.FORMAT,
    mcap.FORMAT,
    megalog.TEXT,
    megalog.BINARY,
)
BY_SUFFIX = {suffix: format_ for format_ in FORMATS for suffix in format_.suffixes}


def require_libraries(sources: Sequence[Source]) -> None:
    """Refuse files that cannot be read for want of a library before any of them is.

    Raises:
        MeasurementError: one is not installed.
    """
    for source in sources:
        format_ = BY_SUFFIX.get(source.path.suffix.casefold())
        for name in () if format_ is None else format_.needs:
            library(name, source.where)


def read_sheets(source: Source) -> list[Sheet]:
    """Every sheet of a file.

    Raises:
        MeasurementError: no such file, or of a format that nobody knows, damaged, or without numbers.
    """
    if source.path.is_dir():
        raise MeasurementError(source.where, "it is a folder.", "A log or a recording is required.",
                               f"Name the files in it: {source.where}/*.")  # fmt: skip
    if not source.path.is_file():
        raise MeasurementError(source.where, "no such file.", "A log or a recording is required.", "Check the path.")
    suffix = source.path.suffix.casefold()
    if suffix not in BY_SUFFIX:
        raise MeasurementError(source.where, f"no format is known for '{suffix or source.path.name}'.",
                               f"Known: {', '.join(BY_SUFFIX)}.", "Export it as one of these.")  # fmt: skip
    sheets = [sheet for sheet in BY_SUFFIX[suffix].read(source) if sheet.columns]
    if not sheets:
        raise MeasurementError(source.where, "no columns of numbers in it.",
                               f"A {BY_SUFFIX[suffix].name} file with recorded signals is required.",
                               "Export the signals, not only the settings.")  # fmt: skip
    return sheets
