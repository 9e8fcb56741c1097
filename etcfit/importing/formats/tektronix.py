"""Tektronix's CSV: settings beside the samples, or above them.

    Record Length,2.500000e+03,,-0.500000000000,  0.04000,      TDS1000, TDS2000, TBS1000: one channel a file
    Sample Interval,4.000000e-04,,-0.499600000000,  0.00000,
    Source,CH1,,-0.498800000000,  0.04000,
    ,,,-0.496000000000,  0.04000,

    Model,MSO44                                                 MDO, MSO, DPO: all channels
    Vertical Units,V,A
    TIME,CH1,CH2
    -5.000e-01,0.04,0.001

Source: Tektronix, programmer manuals of TDS2000 and MSO4000 (SAVE:WAVEFORM:SPREADSHEET), and files as they quote them.
Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...rig.layout import read_text
from ...rig.rows import cells_of, is_number
from ..labels import column
from ..sheet import Sheet, time_base
from .base import unreadable

_KEYS = ("Record Length,", "Model,")
_KIND = "a waveform that a Tektronix scope saved as CSV"


def begins(text: str) -> bool:
    """The first setting of either kind."""
    return text.lstrip('"').startswith(_KEYS)


def read(text: str, where: str) -> list[Sheet]:
    """Its one sheet.

    Raises:
        MeasurementError: no rows of numbers.
    """
    lines = text.split("\n")
    settings = {cells[0].strip(": "): cells[1:] for line in lines[:60] if (cells := cells_of(line, ","))[0]}
    beside = cells_of(lines[0], ",")
    return _beside(lines, settings, where) if len(beside) > 4 and is_number(beside[3]) else _below(
        lines, settings, where)  # fmt: skip


def _beside(lines: list[str], settings: dict[str, list[str]], where: str) -> list[Sheet]:
    rows = [cells_of(line, ",") for line in lines if line.strip()]
    cut_off = len(rows) > 1 and len(rows[-1]) < len(rows[-2])
    rows = rows[:-1] if cut_off else rows
    try:
        time, values = np.array([[float(cell) for cell in row[3:5]] for row in rows]).T
    except ValueError as err:
        raise unreadable(where, "its rows are damaged", _KIND, err) from err
    name, unit = (settings.get(key, [""])[0] for key in ("Source", "Vertical Units"))
    losses = ("the last row is cut off and left out",) if cut_off else ()
    columns = (time_base(time), column(name or "CH1", values, unit))
    return [Sheet(where, "", columns, losses=losses, missing=_missing(settings, len(rows)))]


def _missing(settings: Mapping[str, Sequence[str]], rows: int) -> tuple[str, ...]:
    """What the scope says it saved and the file does not hold."""
    cell = settings.get("Record Length", [""])[0]
    said = int(float(cell)) if is_number(cell) else rows
    told = f"it is cut off or damaged: its record length is {said}, and it holds {rows} rows"
    return (told,) if rows < said else ()


def _below(lines: list[str], settings: dict[str, list[str]], where: str) -> list[Sheet]:
    found = read_text("\n".join(lines), where)
    cells, width = found.numbers.cells, len(found.layout.names)
    # a setting's own cells begin below the first channel; time has its unit in a line of its own
    told = ["s", *settings.get("Vertical Units", []), *[""] * width][:width]
    said = ["", *settings.get("Labels", settings.get("Label", [])), *[""] * width][:width]
    columns = tuple(
        column(said[k] or name, cells[:, k], found.units[k] or told[k])
        for k, name in enumerate(found.layout.names) if said[k] or name
    )  # fmt: skip
    return [Sheet(where, "", columns, found.remarks, found.numbers.losses, _missing(settings, len(cells)))]
