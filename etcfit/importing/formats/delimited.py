"""Text with any lines above its header: PicoScope, Saleae, NI, MoTeC, spreadsheets of any country.

    Zeit;Kanal A;Kanal B          names
    (ms);(V);(mV)                 units in a row of their own, or within the names, or nowhere
                                  blank lines anywhere
    0,00;1,25;48,8                comma, semicolon or tab; decimal point or comma

Source: files as PicoScope 6 and Saleae Logic 2 export them (their help pages). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..labels import column, is_unit, spelled
from ..sheet import Column, Sheet
from .rows import Body, cells_of, find_body, is_number, read_body, refuse_spoilt


def begins(text: str) -> bool:
    """Every text may be one."""
    return True


def read(text: str, where: str) -> list[Sheet]:
    """Its one sheet.

    Raises:
        MeasurementError: no rows of numbers, or something else among them.
    """
    lines = [line if not line.lstrip().startswith("#") else "" for line in text.split("\n")]
    body = find_body(lines, where)
    head = header_above(lines, body)
    refuse_spoilt(lines, head.below, body, where)
    numbers = read_body(lines, body, where)
    units = [told or read for told, read in zip(head.units, numbers.units, strict=True)]
    return [Sheet(where, "", labelled(head.names, units, numbers.cells), numbers.remarks, numbers.losses)]


def labelled(names: Sequence[str], units: Sequence[str], cells: np.ndarray) -> tuple[Column, ...]:
    """A column for each name; those without name and number, which a trailing separator makes, left out."""
    there = [k for k in range(cells.shape[1]) if names[k] or np.isfinite(cells[:, k]).any()]
    return tuple(column(names[k] or f"column {k + 1}", cells[:, k], units[k]) for k in there)


class Header(NamedTuple):
    """What stands above the rows.

    Args:
        names, units: of the columns; "" where there are none.
        below: the line below it, counted from 0.
    """

    names: list[str]
    units: list[str]
    below: int


def header_above(lines: Sequence[str], body: Body) -> Header:
    """The last lines above the rows that may name columns."""
    numbered = [(k, cells_of(line, body.separator)) for k, line in enumerate(lines[: body.first]) if line.strip()]
    above = [(k, _padded(cells, body.width)) for k, cells in numbered if _may_name(cells, body.width)]
    empty = [""] * body.width
    if not above:
        return Header(empty, empty, 0)
    last, cells = above[-1]
    if len(above) > 1 and _are_units(cells):
        return Header(above[-2][1], cells, last + 1)
    return Header(cells, empty, last + 1)


def _may_name(cells: Sequence[str], width: int) -> bool:
    """As many cells as a row has, but for empty ones at its end, and no number."""
    named = len("\0".join(cells).rstrip("\0").split("\0"))
    return named > width // 2 and len(cells) <= width + 1 and not any(is_number(cell) for cell in cells)


def _padded(cells: Sequence[str], width: int) -> list[str]:
    return [*cells, *[""] * width][:width]


def _are_units(cells: Sequence[str]) -> bool:
    """Most of them units, and none a bare name."""
    filled = [cell for cell in cells if cell.strip("[]() ")]
    return bool(filled) and sum(is_unit(spelled(cell)) for cell in filled) >= max(1, len(filled) - 1)
