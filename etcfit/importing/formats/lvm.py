"""LabVIEW's measurement file (.lvm), text.

    LabVIEW Measurement                 settings up to ***End_of_Header***
    Separator<TAB>Tab
    X_Columns<TAB>One                   One: a time for all; Multi: a time before each channel; No: none
    Channels<TAB>2                      a header of its own for each segment, up to ***End_of_Header***
    Samples<TAB>500<TAB>500             rows of each channel; more follow where a program writes again without a header
    Y_Unit_Label<TAB>V<TAB>A
    X0, Delta_X                         t_k = X0 + k Delta_X
    X_Value<TAB>Voltage<TAB>Current<TAB>Comment

Source: National Instruments, Specification for the LabVIEW Measurement File (.lvm). Differs from source: segments
whose channels have times of their own, or different lengths, become a sheet for each time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...rig.rows import cells_of, is_number
from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import unreadable
from .ends import common_ends

_END = "***End_of_Header***"
_KIND = "a LabVIEW measurement file"
_SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass(frozen=True)
class _Dialect:
    """How a file is written: between cells, between digits, and `X_Columns`."""

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


def begins(text: str) -> bool:
    """Its first words."""
    return text.startswith("LabVIEW Measurement")


def read(text: str, where: str) -> list[Sheet]:
    """A sheet for each segment, or for each time in it.

    Raises:
        MeasurementError: no end of a header, or something else than numbers below it.
    """
    head, end, rest = text.partition(_END)
    if not end:
        raise unreadable(where, f"no {_END}", _KIND)
    separator = "," if "Separator,Comma" in head else "\t"
    settings = _Dialect(separator, ".", "").settings(head.split("\n"))
    dialect = _Dialect(
        _SEPARATORS.get(settings.get("Separator", [""])[0].casefold(), separator),
        settings.get("Decimal_Separator", ["."])[0] or ".",
        settings.get("X_Columns", ["One"])[0].casefold(),
    )
    blocks = rest.split(_END)
    sheets: list[Sheet] = []
    for k in range(len(blocks) - 1):
        header = dialect.settings(blocks[k].split("\n"))
        rows = [line for line in blocks[k + 1].split("\n")[1:] if line.strip()]
        part = f"segment {k + 1}" if len(blocks) > 2 else ""
        try:
            sheets += _segment(header, _of_this_segment(rows, dialect), dialect, where, part)
        except (ValueError, IndexError) as err:
            raise unreadable(where, f"{part or 'its rows'} cannot be read", _KIND, err) from err
    if not sheets:
        raise unreadable(where, "it ends within its header", _KIND)
    return sheets


def _of_this_segment(rows: list[str], dialect: _Dialect) -> list[str]:
    """The rows before the header of the next segment."""
    ends = [k for k, row in enumerate(rows) if row.startswith(f"Channels{dialect.separator}")]
    return rows[: ends[0]] if ends else rows


def _segment(header: Mapping[str, list[str]], rows: list[str], dialect: _Dialect, where: str, part: str) -> list[Sheet]:
    names = dialect.cells(rows[0])
    table = [dialect.cells(row) for row in rows[1:]]
    columns = [np.array([dialect.number(row[k] if k < len(row) else "") for row in table]) for k in range(len(names))]
    shown = [k for k, name in enumerate(names) if name and not name.startswith(("X_Value", "Comment"))]
    # the first cell of a setting is its name, that of a row the time: both count from the same cell
    places = [k - any(name.startswith("X_Value") for name in names[:k]) for k in shown]
    said = [int(_cell(header, "Samples", place) or 0) for place in places]
    _refuse_odd_rows(table, shown, len(names), one_length=len(set(said)) < 2)
    ends = common_ends([names[k] for k in shown], [_end(columns[k]) for k in shown], said)
    groups: dict[bytes, list[Column]] = {}
    times: dict[bytes, tuple[Column, ...]] = {}
    for k, place, kept in zip(shown, places, ends.kept, strict=True):
        time = _time(columns, names, k) if dialect.times != "no" else _counted(header, place, len(table), dialect)
        key = kept.to_bytes(8) + (b"" if time is None else time[:kept].tobytes())
        groups.setdefault(key, []).append(column(names[k], columns[k][:kept], _cell(header, "Y_Unit_Label", place)))
        times[key] = () if time is None else (time_base(time[:kept]),)
    _refuse_times_almost_alike([each.values for base in times.values() for each in base])
    return [
        Sheet(where, " ".join(filter(None, (part, made[0].name if len(groups) > 1 else ""))), (*times[key], *made),
              missing=ends.missing)
        for key, made in groups.items()
    ]  # fmt: skip


def _refuse_odd_rows(table: Sequence[list[str]], shown: Sequence[int], width: int, one_length: bool) -> None:
    """Refuse a row whose cells may stand below other names.

    Raises:
        ValueError: one with cells beyond the names, or a number where comments are; one with too few above the last,
            where no channel is shorter.
    """
    for k, cells in enumerate(table):
        beyond = any(cells[width:]) or (k > 0 and any(is_number(cell) for cell in cells[shown[-1] + 1 :]))
        if beyond or (one_length and k < len(table) - 1 and len(cells) <= shown[-1]):
            raise ValueError(f"row {k + 1} has {len(cells)} cells, its header {width}")


def _end(values: np.ndarray) -> int:
    """Rows up to the last that is filled: an empty cell above it is a gap."""
    filled = np.flatnonzero(np.isfinite(values))
    return int(filled[-1]) + 1 if filled.size else 0


def _time(columns: Sequence[np.ndarray], names: Sequence[str], k: int) -> np.ndarray | None:
    """The column of times to the left of a channel's; None where there is none."""
    left = [j for j in range(k) if names[j].startswith("X_Value")]
    return columns[left[-1]] if left else None


def _counted(header: Mapping[str, list[str]], place: int, count: int, dialect: _Dialect) -> np.ndarray | None:
    """By the period that the header gives; None where it gives none."""
    first, step = (dialect.number(_cell(header, key, place)) for key in ("X0", "Delta_X"))
    return None if np.isnan(first + step) else first + step * np.arange(count)


def _cell(header: Mapping[str, list[str]], key: str, place: int) -> str:
    """A channel's own cell of a setting; "" where it has none."""
    cells = header.get(key, [])
    return cells[place] if place < len(cells) else ""


def _refuse_times_almost_alike(times: Sequence[np.ndarray]) -> None:
    """Refuse clocks that agree in most rows: one of them is damaged, and its channel is no trace of its own.

    Raises:
        ValueError: there are two.
    """
    for first, other in combinations(times, 2):
        if first.size == other.size and 0.5 < np.mean(first == other) < 1.0:
            raise ValueError(f"times of two channels differ in row {1 + int(np.argmin(first == other))} alone")
