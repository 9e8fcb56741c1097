"""LabVIEW's measurement file (.lvm), text.

    LabVIEW Measurement                 settings up to ***End_of_Header***
    Separator<TAB>Tab
    X_Columns<TAB>One                   One: a time for all; Multi: a time before each channel; No: none
    Channels<TAB>2                      a header of its own for each segment, up to ***End_of_Header***
    Y_Unit_Label<TAB>V<TAB>A
    X0, Delta_X                         t_k = X0 + k Delta_X
    X_Value<TAB>Voltage<TAB>Current<TAB>Comment

Source: National Instruments, Specification for the LabVIEW Measurement File (.lvm). Differs from source: segments
whose channels have times of their own, or different lengths, become a sheet for each time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import unreadable
from .rows import cells_of

_END = "***End_of_Header***"
_KIND = "a LabVIEW measurement file"
_SEPARATORS = {"tab": "\t", "comma": ","}


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
    settings = _settings(head.split("\n"), separator)
    separator = _SEPARATORS.get(settings.get("Separator", [""])[0].casefold(), separator)
    mark = settings.get("Decimal_Separator", ["."])[0] or "."
    times = settings.get("X_Columns", ["One"])[0]
    blocks = rest.split(_END)
    sheets: list[Sheet] = []
    for k in range(len(blocks) - 1):
        header = _settings(blocks[k].split("\n"), separator)
        rows = [line for line in blocks[k + 1].split("\n")[1:] if line.strip()]
        part = f"segment {k + 1}" if len(blocks) > 2 else ""
        try:
            sheets += _segment(header, _of_this_segment(rows, separator), times, separator, mark, where, part)
        except (ValueError, IndexError) as err:
            raise unreadable(where, f"{part or 'its rows'} cannot be read", _KIND, err) from err
    return sheets


def _settings(lines: Sequence[str], separator: str) -> dict[str, list[str]]:
    cells = [cells_of(line, separator) for line in lines if line.strip()]
    return {each[0]: each[1:] for each in cells if each[0]}


def _of_this_segment(rows: list[str], separator: str) -> list[str]:
    """The rows before the header of the next segment."""
    ends = [k for k, row in enumerate(rows) if row.startswith(f"Channels{separator}")]
    return rows[: ends[0]] if ends else rows


def _segment(
    header: dict[str, list[str]], rows: list[str], times: str, separator: str, mark: str, where: str, part: str
) -> list[Sheet]:
    names = cells_of(rows[0], separator)
    cells = [cells_of(row, separator) for row in rows[1:]]
    columns = {k: np.array([_number(row[k] if k < len(row) else "", mark) for row in cells]) for k in range(len(names))}
    units = header.get("Y_Unit_Label", [])
    shown = [k for k, name in enumerate(names) if name and not name.startswith(("X_Value", "Comment"))]
    groups: dict[bytes, tuple[np.ndarray, list[Column]]] = {}
    for k in shown:
        filled = np.isfinite(columns[k])
        # the first cell of a setting is its name, that of a row the time: both count from the same cell
        x = columns[_time_of(k, names)] if times.casefold() != "no" else _counted(header, k - 1, len(cells), mark)
        made = column(names[k], columns[k][filled], units[k - 1] if k - 1 < len(units) else "")
        groups.setdefault(x[filled].tobytes(), (x[filled], []))[1].append(made)
    several = len(groups) > 1
    return [
        Sheet(where, " ".join(filter(None, (part, made[0].name if several else ""))), (time_base(x), *made))
        for x, made in groups.values()
    ]


def _time_of(k: int, names: Sequence[str]) -> int:
    """The column of times to the left of this one."""
    return max(j for j in range(k) if names[j].startswith("X_Value"))


def _counted(header: dict[str, list[str]], channel: int, count: int, mark: str) -> np.ndarray:
    first, step = (_number(header[key][channel], mark) for key in ("X0", "Delta_X"))
    return first + step * np.arange(count)


def _number(cell: str, mark: str) -> float:
    return float(cell.replace(mark, ".")) if cell else np.nan
