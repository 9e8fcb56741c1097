"""The rows of a plain CSV by NumPy's C reader: the same numbers as `table` reads, in a tenth of the time.

It knows no messages: what is not plain it leaves to the careful reader, which either takes it or says what is wrong.
"""

from __future__ import annotations

import io
import re

import numpy as np

LINES_TO_LOOK_AT = 20
GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}", re.ASCII) for mark in ".,"}
_OF_NUMBERS = "0123456789+-eE \n"  # what plain rows consist of besides a decimal mark and the separator


def fast_cells(body: str, separator: str, width: int, largest: float) -> np.ndarray | None:
    """The numbers in these rows, shape (n, width), NaN where a cell is empty; None where the rows are not plain.

    Plain rows have a number or nothing in each of `width` cells and nothing between them: no comment, quote or blank
    line, and a decimal mark that cannot part thousands.

    Args:
        body: the rows, each ended by `\\n`, the last perhaps not.
        separator: between cells.
        width: cells in a row.
        largest: magnitude beyond which a number is none.
    """
    if not body.isascii():
        return None
    mark = _decimal_mark(body, separator)
    if mark is None:
        return None
    rows = (body.replace(",", ".") if mark == "," else body).rstrip("\n").encode("ascii")
    if not _is_regular(rows, separator.encode("ascii"), width):
        return None
    cells = _read(rows, separator, width)
    return cells if cells is not None and not np.any(np.abs(cells) > largest) else None


def _decimal_mark(body: str, separator: str) -> str | None:
    """`.` or `,`; None where one could part thousands, which the careful reader decides from every cell."""
    if separator == ",":
        return "."
    point, comma = "." in body, "," in body
    if not (point or comma):
        return "."
    mark = "," if comma else "."
    cells = (cell.strip() for line in body.split("\n", LINES_TO_LOOK_AT)[:-1] for cell in line.split(separator))
    plain = any(mark in cell and not GROUPED[mark].fullmatch(cell) for cell in cells)
    return mark if plain and not (point and comma) else None


def _is_regular(rows: bytes, separator: bytes, width: int) -> bool:
    """Nothing but numbers, and as many separators in all as rows of this width have; `_read` counts row by row."""
    if not rows or rows.startswith(b"\n") or b"\n\n" in rows:
        return False
    allowed = _OF_NUMBERS.encode("ascii") + b"." + separator
    lines = rows.count(b"\n") + 1
    return not rows.translate(None, allowed) and rows.count(separator) == lines * (width - 1)


def _read(rows: bytes, separator: str, width: int) -> np.ndarray | None:
    cells = _numbers(rows, separator)
    if cells is None and (filled := _filled(rows, separator)) != rows:
        cells = _numbers(filled, separator)
    return cells if cells is not None and cells.shape == (rows.count(b"\n") + 1, width) else None


def _numbers(rows: bytes, separator: str) -> np.ndarray | None:
    """None where a cell is no number or rows are of unequal width."""
    try:
        return np.loadtxt(io.BytesIO(rows), delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        return None


def _filled(rows: bytes, separator: str) -> bytes:
    """The same with NaN in empty cells, which are no numbers to NumPy."""
    mark = re.escape(separator.encode("ascii"))
    return re.sub(rb"(?m)(?:^|(?<=" + mark + rb")) *(?=" + mark + rb"|$)", b"nan", rows)
