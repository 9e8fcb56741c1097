"""MegaLogViewer's text log (.msl) as a table.

    "rusEFI 20230701"                   any lines in quotes
    Time<TAB>TPS<TAB>ETB: position target
    s<TAB>%<TAB>%
    0.000<TAB>4.1<TAB>4.0
    MARK 000 - lap 1                    anywhere among the rows

Source: EFI Analytics, MegaLogViewer; as TunerStudio and mlg-converter write it.
"""

from __future__ import annotations

import numpy as np

from ..errors import MeasurementError
from .table import Table, decode


def read_msl(raw: bytes, where: str) -> Table:
    """Columns named `name [unit]`; NaN where a cell holds no number (a switch in words, say).

    Rows with too few cells are left out, which `losses` says; so is a last line without an end.

    Args:
        raw: the file.
        where: its path, as the user gave it.
    Raises:
        MeasurementError: no text, or no header with rows of numbers below it.
    """
    numbered = list(enumerate(decode(raw, where).split("\n"), start=1))
    head = next((k for k, (_, text) in enumerate(numbered) if "\t" in text), None)
    if head is None or head + 2 >= len(numbered):
        raise _no_log(where, "no header of names parted by tabs.")
    names, units = ([cell.strip().strip('"') for cell in text.split("\t")] for _, text in numbered[head : head + 2])
    if _is_row(units):
        units, first = [""] * len(names), head + 1
    else:
        units, first = [*units, *[""] * len(names)][: len(names)], head + 2
    rows = [(line, cells) for line, text in numbered[first:-1] if _is_row(cells := text.split("\t"))]
    short = [line for line, cells in rows if len(cells) < len(names)]
    rows = [(line, cells) for line, cells in rows if len(cells) >= len(names)]
    if not rows:
        raise _no_log(where, "no row of numbers below its header.")
    header = tuple(named(name, unit) for name, unit in zip(names, units, strict=True))
    values = np.array([[_number(cell) for cell in cells[: len(names)]] for _, cells in rows])
    spoilt = np.isnan(values) & np.array([[bool(cell.strip()) for cell in cells[: len(names)]] for _, cells in rows])
    few = [
        (names[k], int(n)) for k, n in enumerate(spoilt.sum(axis=0)) if 0 < 2 * n < len(rows)
    ]  # not a switch in words
    words = tuple(f"'{name}': {n} cells that hold no number are gaps" for name, n in few)
    lines = ", ".join(map(str, short[:5])) + (", and more" if len(short) > 5 else "")
    losses = (f"rows with too few cells are left out: {len(short)}, in lines {lines}",) if short else ()
    cut = ("the last line has no end: it may be cut off, and is left out",) if numbered[-1][1].strip() else ()
    return Table(
        header, numbered[head][0], np.array([line for line, _ in rows]), values, losses=(*losses, *words, *cut)
    )


def named(name: str, unit: str) -> str:
    """A header as our CSVs have it."""
    return f"{name} [{unit}]" if unit else name


def _is_row(cells: list[str]) -> bool:
    """True for a row of the log, which begins with its time; not for units, marks and blank lines."""
    return bool(np.isfinite(_number(cells[0])))


def _number(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan


def _no_log(where: str, found: str) -> MeasurementError:
    required = "An .msl has a line of names, a line of units and rows, parted by tabs."
    return MeasurementError(where, found, required, "Export it again from MegaLogViewer or TunerStudio, or as CSV.")
