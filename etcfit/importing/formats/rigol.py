"""Rigol's CSV: samples without a time of their own.

    X,CH1,CH2,Start,Increment,                    DS1000, DS2000, MSO1000
    Sequence,Volt,Volt,-6.000000e-02,2.000000e-05
    0,1.20e+00,-4.00e-02,
    Time(s),CH1(V),t0 = -5.0e-03,tInc = 1.0e-06,  MSO5000, DHO
    ,1.20e+00,

    t_k = start + k increment

Source: files of a DS1054Z and an MSO5000, as open readers of them quote their first lines. Differs from source: no.
"""

from __future__ import annotations

import re

import numpy as np

from ...rig.rows import cells_of
from ..labels import column
from ..sheet import Sheet, time_base
from .base import unreadable

_CLOCK = re.compile(r"(?P<key>t0|tInc)\s*=\s*(?P<value>[-+0-9.eE]+)\s*s?")
_KIND = "a waveform that a Rigol scope saved as CSV"


def begins(text: str) -> bool:
    """One of the two headers."""
    first = text.partition("\n")[0]
    return (first.startswith("X,") and "Increment" in first) or "tInc" in first


def read(text: str, where: str) -> list[Sheet]:
    """Its one sheet.

    Raises:
        MeasurementError: no start or increment, or something else than numbers below.
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
        _refuse_odd_rows(cells, head[0] == "X")
        table = np.array([_row(row, len(names)) for row in cells])
    except ValueError as err:
        raise unreadable(where, "its header or rows are damaged", _KIND, err) from err
    time = time_base(start + increment * np.arange(len(table)))
    analog = [k for k in range(len(names)) if np.isfinite(table[:, k]).any()] if len(table) else []
    losses = ("the last row is cut off and left out",) if cut_off else ()
    columns = (time, *(column(names[k], table[:, k], units[k]) for k in analog))
    return [Sheet(where, "", columns, losses=losses)] if analog else []


def _refuse_odd_rows(rows: list[list[str]], numbered: bool) -> None:
    """Refuse a row that would shift the clock of all below it: samples are known by their place alone.

    Raises:
        ValueError: one of another length, or whose number is not its place.
    """
    for k, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise ValueError(f"row {k + 1} has {len(row)} cells, the first {len(rows[0])}")
        if numbered and float(row[0]) - float(rows[0][0]) != k:
            raise ValueError(f"row {k + 1} is number {row[0]}")


def _row(cells: list[str], count: int) -> list[float]:
    """The channels of a row; logic channels, in hexadecimal, are none here."""
    shown = [*cells[1 : 1 + count], *[""] * count][:count]
    return [float(cell) if cell and not cell.startswith("0x") else np.nan for cell in shown]
