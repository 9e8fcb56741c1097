"""VCDS (VAG-COM): a clock before each group of columns, names and units in several rows above, in any language.

    Friday,05,July,...-VCID:AA06E9...,VCDS Version: Release 24.7.1 (x64)
    ,Group A:,'060,,,Group B:,'001                 measuring blocks: groups of up to four values
    ,,Throttle Valve,Throttle Valve,,Engine Speed
    ,TIME,(G187),(G188),TIME,
    Marker,STAMP, %, %,STAMP, /min
    ,0.30,12.5,87.4,0.60,1560

    Marker,TIME,Loc. IDE00021,TIME,Loc. IDE00075   measured values: a clock each; the units in a row of their own
    ,STAMP,Engine RPM,STAMP,Vehicle speed
    ,, /min,, km/h

The header of the first clock is that of every other clock, in any language. Instants of all groups are rows, with gaps
where a group has none.

Source: logs of VCDS 21 to 25 in public repositories; Ross-Tech, VCDS manual, "Logging". Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...rig.rows import cells_of, is_number, number_in
from ..sheet import Sheet, column, time_base
from .base import unreadable, with_gaps

_KIND = "a log of VCDS"
_ABOUT = 2  # lines of the day and of the control unit


def is_vcds(text: str) -> bool:
    """Whether the first line of a text names the program or its licence."""
    first = text.partition("\n")[0]
    return "VCDS" in first or "VCID:" in first


def read_vcds(text: str, where: str) -> list[Sheet]:
    """One sheet, its time in seconds.

    Raises:
        MeasurementError: no clock, no rows, or a clock that falls.
    """
    rows = [cells for line in text.split("\n") if any(cells := cells_of(line, ","))]
    first = next((k for k in range(_ABOUT, len(rows)) if len(rows[k]) > 2 and is_number(rows[k][1])), 0)
    clocked = [k for k in range(_ABOUT, first) if len(rows[k]) > 2 and rows[k][1] and not rows[k][1].endswith(":")]
    if not clocked:
        raise unreadable(where, "no row of names with a clock above its numbers", _KIND)
    stamps, width = rows[clocked[-1]], max(map(len, rows[first:]))
    clocks = [k for k, cell in enumerate(stamps) if cell == stamps[1]]
    names, units = _names_and_units(rows[:first], clocked[-1], clocks, width)
    # words describe the state of a control unit and are no signal
    values = np.array([[np.nan if (found := number_in(cell)) is None else found
                        for cell in [*cells, *[""] * width][:width]] for cells in rows[first:]])  # fmt: skip
    if any(np.any(np.diff(values[np.isfinite(values[:, k]), k]) < 0.0) for k in clocks):
        raise unreadable(where, "a clock falls", _KIND)
    instants = np.unique(values[:, clocks][np.isfinite(values[:, clocks])])
    columns = []
    for k in (k for k in range(1, width) if k not in clocks and names[k]):
        clock = values[:, max(each for each in clocks if each < k)]
        there = np.isfinite(clock)
        columns.append(column(names[k], with_gaps(instants.size, np.searchsorted(instants, clock[there]),
                                                  values[there, k]), units[k]))  # fmt: skip
    remark = f"{len(clocks)} groups with clocks of their own: every instant is a row"
    return [Sheet(where, "", (time_base(instants), *columns), (remark,) if len(clocks) > 1 else ())]


def _names_and_units(
    head: Sequence[list[str]], place: int, clocks: Sequence[int], width: int
) -> tuple[list[str], list[str]]:
    """Names and units of each column; names of measuring blocks may be split over rows.

    Args:
        head: rows above the numbers.
        place: index of the row with the clocks' header.
        clocks: columns with a clock.
        width: number of columns.
    """
    above = [[*cells, *[""] * width][:width] for cells in head]
    blocks = next((k for k in range(place, -1, -1) if head[k][1:2] and head[k][1].endswith(":")), None)
    named = above[place : place + 1] if blocks is None else above[blocks + 1 : place]
    units = above[-1] if blocks is not None or place + 1 < len(above) else [""] * width
    names = [" ".join(filter(None, (cells[k] for cells in named))) for k in range(width)]
    names = ["" if k in clocks else name for k, name in enumerate(names)]
    return names, [unit.replace("*", "°") for unit in units]  # VCDS writes a degree as *C
