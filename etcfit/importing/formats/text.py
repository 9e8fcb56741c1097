"""Reads text files: CSV of Tektronix and Rigol scopes, LabVIEW's .lvm, MegaLogViewer's .msl, any other table.

The first lines show the dialect of a file (`DIALECTS`). A log of a bus, frames as bytes, is recognised only to give a
clear error, for it cannot be decoded without the bus's DBC; frames are decoded from MDF only (`mdf`). Files in none of
them are read by `rig.layout`, which finds header, separator and units by itself. MegaLogViewer's binary log (.mlg) is
here too, with its text form.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...errors import MeasurementError
from ...rig.layout import TextTable, read_msl, read_text
from ...rig.mlg import read_mlg
from ...rig.rows import cells_of, is_number
from ...rig.table import decode
from ..sheet import Column, Sheet, column, time_base
from .base import Format, Source, common_ends, unreadable
from .vcds import is_vcds, read_vcds

_NO_END = "the last line has no end: it may be cut off, and is left out"
_CUT_ROW = "the last row is cut off and left out"
_END_OF_HEADER = "***End_of_Header***"
_LABVIEW, _RIGOL, _TEKTRONIX = (
    "a LabVIEW measurement file",
    "a waveform that a Rigol scope saved as CSV",
    "a waveform that a Tektronix scope saved as CSV",
)
_CLOCK = re.compile(r"(?P<key>t0|tInc)\s*=\s*(?P<value>[-+0-9.eE]+)\s*s?")


def _sheet_of(found: TextTable, where: str, losses: tuple[str, ...] = ()) -> Sheet:
    """A column for each name, without the empty columns of a trailing separator."""
    names, cells = found.layout.names, found.numbers.cells
    columns = tuple(
        column(name or f"column {k + 1}", cells[:, k], found.units[k])
        for k, name in enumerate(names)
        if name or not all(cells[:, k] != cells[:, k])
    )
    return Sheet(where, "", columns, found.remarks, (*found.numbers.losses, *losses))


def _tektronix(text: str, where: str) -> list[Sheet]:
    """Tektronix's CSV: settings to the left of the samples, or above them.

        Record Length,2.500000e+03,,-0.500000000000,  0.04000,      TDS1000, TDS2000, TBS1000: one channel a file
        Sample Interval,4.000000e-04,,-0.499600000000,  0.00000,
        Source,CH1,,-0.498800000000,  0.04000,
        ,,,-0.496000000000,  0.04000,

        Model,MSO44                                                 MDO, MSO, DPO: all channels
        Vertical Units,V,A
        TIME,CH1,CH2
        -5.000e-01,0.04,0.001

    Source: Tektronix, programmer manuals of TDS2000 and MSO4000 (SAVE:WAVEFORM:SPREADSHEET), and files as they quote
    them. Differs from source: no.
    """
    lines = text.split("\n")
    settings = {cells[0].strip(": "): cells[1:] for line in lines[:60] if (cells := cells_of(line, ","))[0]}

    def missing(rows: int) -> tuple[str, ...]:
        """Sentences on samples that the scope saved and the file lacks."""
        cell = settings.get("Record Length", [""])[0]
        said = int(float(cell)) if is_number(cell) else rows
        told = f"it is cut off or damaged: its record length is {said}, and it holds {rows} rows"
        return (told,) if rows < said else ()

    first = cells_of(lines[0], ",")
    if len(first) > 4 and is_number(first[3]):
        rows = [cells_of(line, ",") for line in lines if line.strip()]
        cut_off = len(rows) > 1 and len(rows[-1]) < len(rows[-2])
        rows = rows[:-1] if cut_off else rows
        try:
            time, values = np.array([[float(cell) for cell in row[3:5]] for row in rows]).T
        except ValueError as err:
            raise unreadable(where, "its rows are damaged", _TEKTRONIX, err) from err
        name, unit = (settings.get(key, [""])[0] for key in ("Source", "Vertical Units"))
        columns = (time_base(time), column(name or "CH1", values, unit))
        return [Sheet(where, "", columns, losses=(_CUT_ROW,) if cut_off else (), missing=missing(len(rows)))]
    found = read_text(text, where)
    cells, width = found.numbers.cells, len(found.layout.names)
    # a setting's own cells begin below the first channel; time has its unit in a line of its own
    told = ["s", *settings.get("Vertical Units", []), *[""] * width][:width]
    said = ["", *settings.get("Labels", settings.get("Label", [])), *[""] * width][:width]
    columns = tuple(
        column(said[k] or name, cells[:, k], found.units[k] or told[k])
        for k, name in enumerate(found.layout.names) if said[k] or name
    )  # fmt: skip
    return [Sheet(where, "", columns, found.remarks, found.numbers.losses, missing(len(cells)))]


def _rigol(text: str, where: str) -> list[Sheet]:
    """Rigol's CSV: samples without a time of their own.

        X,CH1,CH2,Start,Increment,                    DS1000, DS2000, MSO1000
        Sequence,Volt,Volt,-6.000000e-02,2.000000e-05
        0,1.20e+00,-4.00e-02,
        Time(s),CH1(V),t0 = -5.0e-03,tInc = 1.0e-06,  MSO5000, DHO
        ,1.20e+00,

        t_k = start + k increment

    Source: files of a DS1054Z and an MSO5000, as open readers of them quote their first lines. Differs from source: no.
    """
    lines = text.split("\n")
    head = cells_of(lines[0], ",")
    if head[0] == "X":
        units = cells_of(lines[1], ",") if len(lines) > 1 else []
        names = head[1 : head.index("Start")] if "Start" in head else []
        rows, clock = lines[2:], units[1 + len(names) : 3 + len(names)]
        units = units[1 : 1 + len(names)]
    else:
        found = {match["key"]: match["value"] for cell in head if (match := _CLOCK.fullmatch(cell))}
        names = [cell for cell in head[1:] if cell and not _CLOCK.fullmatch(cell)]
        rows, clock, units = lines[1:], [found.get("t0", ""), found.get("tInc", "")], [""] * len(names)
    try:
        start, increment = (float(each) for each in clock)
        cells = [cells_of(line, ",") for line in rows if line.strip()]
        cut_off = len(cells) > 1 and len(cells[-1]) < len(cells[0])
        cells = cells[:-1] if cut_off else cells
        _refuse_shifted_rows(cells, head[0] == "X")
        # logic channels, in hexadecimal, are left out
        table = np.array([
            [float(cell) if cell and not cell.startswith("0x") else np.nan
             for cell in [*row[1 : 1 + len(names)], *[""] * len(names)][: len(names)]]
            for row in cells
        ])  # fmt: skip
    except ValueError as err:
        raise unreadable(where, "its header or rows are damaged", _RIGOL, err) from err
    time = time_base(start + increment * np.arange(len(table)))
    analog = [k for k in range(len(names)) if np.isfinite(table[:, k]).any()] if len(table) else []
    columns = (time, *(column(names[k], table[:, k], units[k]) for k in analog))
    return [Sheet(where, "", columns, losses=(_CUT_ROW,) if cut_off else ())] if analog else []


def _refuse_shifted_rows(rows: list[list[str]], numbered: bool) -> None:
    """Refuse a row that would shift the clock of all rows below: only its place gives a sample's time."""
    for k, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise ValueError(f"row {k + 1} has {len(row)} cells, the first {len(rows[0])}")
        if numbered and float(row[0]) - float(rows[0][0]) != k:
            raise ValueError(f"row {k + 1} is number {row[0]}")


@dataclass(frozen=True)
class _Dialect:
    """The dialect of a LabVIEW file: separator of cells, decimal point, and `X_Columns`."""

    separator: str
    mark: str
    times: str

    def cells(self, line: str) -> list[str]:
        return cells_of(line, self.separator)

    def number(self, cell: str) -> float:
        return float(cell.replace(self.mark, ".")) if cell else np.nan

    def settings(self, lines: Sequence[str]) -> dict[str, list[str]]:
        cells = [self.cells(line) for line in lines if line.strip()]
        return {each[0]: each[1:] for each in cells if each[0]}


def _labview(text: str, where: str) -> list[Sheet]:
    """LabVIEW's measurement file (.lvm), text; a sheet for each segment, or for each time in it.

        LabVIEW Measurement                 settings up to ***End_of_Header***
        Separator<TAB>Tab
        X_Columns<TAB>One                   One: a time for all; Multi: a time before each channel; No: none
        Channels<TAB>2                      a header of its own for each segment, up to ***End_of_Header***
        Samples<TAB>500<TAB>500             rows of each channel; more follow where a program writes again without one
        Y_Unit_Label<TAB>V<TAB>A
        X0, Delta_X                         t_k = X0 + k Delta_X
        X_Value<TAB>Voltage<TAB>Current<TAB>Comment

    Source: National Instruments, Specification for the LabVIEW Measurement File (.lvm). Differs from source: segments
    whose channels have times of their own, or different lengths, become a sheet for each time.
    """
    head, end, rest = text.partition(_END_OF_HEADER)
    if not end:
        raise unreadable(where, f"no {_END_OF_HEADER}", _LABVIEW)
    separator = "," if "Separator,Comma" in head else "\t"
    settings = _Dialect(separator, ".", "").settings(head.split("\n"))
    dialect = _Dialect(
        {"tab": "\t", "comma": ","}.get(settings.get("Separator", [""])[0].casefold(), separator),
        settings.get("Decimal_Separator", ["."])[0] or ".",
        settings.get("X_Columns", ["One"])[0].casefold(),
    )
    blocks = rest.split(_END_OF_HEADER)
    sheets: list[Sheet] = []
    for k in range(len(blocks) - 1):
        header = dialect.settings(blocks[k].split("\n"))
        rows = [line for line in blocks[k + 1].split("\n")[1:] if line.strip()]
        # up to the header of the next segment
        ends = [j for j, row in enumerate(rows) if row.startswith(f"Channels{dialect.separator}")]
        part = f"segment {k + 1}" if len(blocks) > 2 else ""
        try:
            sheets += _segment(header, rows[: ends[0]] if ends else rows, dialect, where, part)
        except (ValueError, IndexError) as err:
            raise unreadable(where, f"{part or 'its rows'} cannot be read", _LABVIEW, err) from err
    if not sheets:
        raise unreadable(where, "it ends within its header", _LABVIEW)
    return sheets


def _segment(header: Mapping[str, list[str]], rows: list[str], dialect: _Dialect, where: str, part: str) -> list[Sheet]:
    names = dialect.cells(rows[0])
    table = [dialect.cells(row) for row in rows[1:]]
    columns = [np.array([dialect.number(row[k] if k < len(row) else "") for row in table]) for k in range(len(names))]
    shown = [k for k, name in enumerate(names) if name and not name.startswith(("X_Value", "Comment"))]
    # the first cell of a setting is its name, that of a row the time: both are counted from the same cell
    places = [k - any(name.startswith("X_Value") for name in names[:k]) for k in shown]

    def setting(key: str, place: int) -> str:
        """A channel's own cell, or ""."""
        cells = header.get(key, [])
        return cells[place] if place < len(cells) else ""

    def time_of(k: int, place: int) -> np.ndarray | None:
        """The column of times to the left of a channel's column, or times from the period in the header, or None."""
        if dialect.times != "no":
            left = [j for j in range(k) if names[j].startswith("X_Value")]
            return columns[left[-1]] if left else None
        first, step = (dialect.number(setting(key, place)) for key in ("X0", "Delta_X"))
        return None if np.isnan(first + step) else first + step * np.arange(len(table))

    said = [int(setting("Samples", place) or 0) for place in places]
    _refuse_odd_rows(table, shown, len(names), one_length=len(set(said)) < 2)
    # up to the last filled row: an empty cell above it is a gap
    filled = [np.flatnonzero(np.isfinite(columns[k])) for k in shown]
    ends, missing = common_ends([names[k] for k in shown], [int(f[-1]) + 1 if f.size else 0 for f in filled], said)
    groups: dict[bytes, list[Column]] = {}
    times: dict[bytes, tuple[Column, ...]] = {}
    for k, place, kept in zip(shown, places, ends, strict=True):
        time = time_of(k, place)
        key = kept.to_bytes(8) + (b"" if time is None else time[:kept].tobytes())
        groups.setdefault(key, []).append(column(names[k], columns[k][:kept], setting("Y_Unit_Label", place)))
        times[key] = () if time is None else (time_base(time[:kept]),)
    # clocks that agree in most rows: one of them is damaged, and its channel is not a separate trace
    for first, other in combinations([each.values for base in times.values() for each in base], 2):
        if first.size == other.size and 0.5 < np.mean(first == other) < 1.0:
            raise ValueError(f"times of two channels differ in row {1 + int(np.argmin(first == other))} alone")
    return [
        Sheet(where, " ".join(filter(None, (part, made[0].name if len(groups) > 1 else ""))), (*times[key], *made),
              missing=missing)
        for key, made in groups.items()
    ]  # fmt: skip


def _refuse_odd_rows(table: Sequence[list[str]], shown: Sequence[int], width: int, one_length: bool) -> None:
    """Refuse a row whose cells may be below wrong names."""
    for k, cells in enumerate(table):
        beyond = any(cells[width:]) or (k > 0 and any(is_number(cell) for cell in cells[shown[-1] + 1 :]))
        if beyond or (one_length and k < len(table) - 1 and len(cells) <= shown[-1]):
            raise ValueError(f"row {k + 1} has {len(cells)} cells, its header {width}")


def _is_rigol(text: str) -> bool:
    first = text.partition("\n")[0]
    return (first.startswith("X,") and "Increment" in first) or "tInc" in first


# the first characters of a bus log by program. Source: can-utils, candump; Vector, ASC logging; BUSMASTER; samples of
# SavvyCAN (GVRET) and python-can
_BUS = (
    ("candump", re.compile(r"\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]+#")),
    ("SavvyCAN", re.compile(r"(Time Stamp,ID,Extended|ID,Data Bytes)")),
    ("BUSMASTER", re.compile(r"\*\*\*BUSMASTER")),
    ("Vector", re.compile(r"date [^\n]*\n\s*base (hex|dec)\s+timestamps ")),
)


def _bus_program(text: str) -> str | None:
    return next((name for name, pattern in _BUS if pattern.match(text)), None)


def _refuse_bus(text: str, where: str) -> list[Sheet]:
    found = f"frames of a bus as bytes, as {_bus_program(text)} logs them."
    raise MeasurementError(where, found, "Signals are needed: position, setpoint, duty.",
                           "Decode the frames with the bus's DBC and export the signals as CSV, or log as MDF (.mf4) "
                           "and give `etcfit import` the DBC beside it.")  # fmt: skip


# (test of the file's beginning, reader); the first match counts
DIALECTS: tuple[tuple[Callable[[str], bool], Callable[[str, str], list[Sheet]]], ...] = (
    (lambda text: text.startswith("LabVIEW Measurement"), _labview),
    (_is_rigol, _rigol),
    (lambda text: text.lstrip('"').startswith(("Record Length,", "Model,")), _tektronix),
    (is_vcds, read_vcds),
    (lambda text: _bus_program(text) is not None, _refuse_bus),
    (lambda text: True, lambda text, where: [_sheet_of(read_text(text, where), where)]),
)


def _read(source: Source) -> list[Sheet]:
    raw = source.path.read_bytes()
    if raw.endswith(b"\r") and b"\r\n" in raw:  # half of a line end
        raw = raw[:-1]
    text = decode(raw, source.where).removeprefix("\ufeff")
    whole, end, rest = text.rpartition("\n")
    losses = (_NO_END,) if rest.strip() else ()
    if source.path.suffix.casefold() == ".msl":
        return [_sheet_of(read_msl(f"{whole}\n", source.where), source.where, losses)]
    reader = next(read for begins, read in DIALECTS if begins(text))
    if not (end and losses):
        return reader(text, source.where)
    return [replace(sheet, losses=(*sheet.losses, *losses)) for sheet in reader(whole + end, source.where)]


def _read_mlg(source: Source) -> list[Sheet]:
    table = read_mlg(source.path.read_bytes(), source.where)
    columns = tuple(column(name, table.cells[:, k]) for k, name in enumerate(table.header))
    return [Sheet(source.where, "", columns, losses=table.losses)]


FORMAT = Format("text", (".csv", ".txt", ".tsv", ".asc", ".dat", ".lvm", ".log", ".msl"), _read)
MEGALOG = Format("MegaLogViewer binary", (".mlg",), _read_mlg)
