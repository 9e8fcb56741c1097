"""Reads a CSV file as a table of numbers: finds encoding, separator and decimal mark, and refuses errors by line.

Accepted where unambiguous: comma, semicolon or tab; decimal comma; UTF-8 with or without BOM, UTF-16, Windows-1252;
any line ending; Excel's `sep=;`; quoted cells. Lines that begin with `#` and blank lines are skipped but counted.
Any other layout that `layout` knows, for example lines above the header or units below it, is read as by `etcfit
import`.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import MeasurementError
from .layout import read_text
from .rows import LINES_TO_LOOK_AT, NUMBER, SEPARATORS, fast_cells, quoted_cells, read_rows

LINES_OF_A_TOP = 200  # most lines of comments and header for the fast reader
CONTROL = bytes((*range(0x09), *range(0x0E, 0x20), 0x7F))  # all control characters except tab and line ends
EXCEL_ERROR = re.compile(r"#(N/A|NV|[A-ZÜ0-9/]+[!?])\s*([,;\t]|$)")  # a failed formula in the first cell is no comment
_BOMS = (  # UTF-32 before UTF-16: its little-endian mark begins with UTF-16's
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True, eq=False)
class Table:
    """Header cells as written, numbers below them."""

    header: tuple[str, ...]  # shape (m,)
    header_line: int  # line of the header in the file, counted from 1; 0 where there is no file
    lines: np.ndarray  # line of each row in the file, shape (n,)
    cells: np.ndarray  # shape (n, m); NaN where the cell is empty, finite elsewhere
    row_mark: str = ":"  # text between the table's name and the number of a row in a message
    losses: tuple[str, ...] = ()  # rows that were left out because they are damaged, each in a sentence

    def head(self, where: str) -> str:
        """File and line of the header, for a message."""
        return f"{where}:{self.header_line}" if self.header_line else where

    def at(self, where: str, row: int) -> str:
        """File and line of a row, for a message."""
        return f"{where}{self.row_mark}{self.lines[row]}"


def decode(raw: bytes, where: str) -> str:
    """The text in these bytes, with line ends `\\n`.

    Raises:
        MeasurementError: it is no text.
    """
    try:
        text = raw.decode(_encoding(raw))
    except UnicodeDecodeError as err:
        raise _not_text(where, f"the bytes at offset {err.start} are no {err.encoding} text.") from err
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    plain = text.encode("utf-8") if text.isascii() else b""
    is_clean = plain and len(plain.translate(None, CONTROL)) == len(plain)  # otherwise each letter is examined
    if not is_clean and (control := re.search(rf"[{CONTROL.decode('ascii')}]", text)):
        line = text.count("\n", 0, control.start()) + 1
        raise _not_text(f"{where}:{line}", f"control character {control[0]!r} found.")
    return text


def parse(text: str, where: str) -> Table:
    """The table in this text.

    A plain text is read by the fast reader, any other by the careful one; tables and messages are the same. A text of
    another layout is read as by `etcfit import`; where that fails too, the message is that on the header in the first
    line.

    Raises:
        MeasurementError: empty, header only, rows of unequal length, or anything but numbers below the header.
    """
    table = parse_plain(text, where)
    if table is None:
        table = _of_another_layout(text, where)
    return parse_with_care(text, where) if table is None else table


def headed(name: str, unit: str) -> str:
    """A header in the form of our CSV files."""
    return f"{name} [{unit}]" if unit and not name.rstrip().endswith("]") else name


def _of_another_layout(text: str, where: str) -> Table | None:
    """The table of a text whose header is not its first line, or has units below it; None for other texts."""
    numbered = _content(text, where)
    try:
        found = read_text(text, where)
    except MeasurementError:
        return None
    layout = found.layout
    first_line = layout.head == _announced_separator(numbered)[1][0][0]
    if not layout.head or (first_line and not any(layout.units)) or len(layout.names) < 2:
        return None
    # without columns that have neither name nor number, which a trailing separator causes
    cells = found.numbers.cells
    there = [k for k, name in enumerate(layout.names) if name or np.isfinite(cells[:, k]).any()]
    header = tuple(headed(layout.names[k] or f"column {k + 1}", found.units[k]) for k in there)
    table = Table(header, layout.head, found.numbers.lines, cells[:, there], losses=found.numbers.losses)
    return without_blanks(table, where)


def parse_plain(text: str, where: str) -> Table | None:
    """The table in this text where the fast reader can read it; otherwise None, without a message.

    Raises:
        MeasurementError: numbers in a column without a name.
    """
    try:
        top, body = _top("\n".join(text.split("\n", LINES_OF_A_TOP)[:LINES_OF_A_TOP]), where)
    except MeasurementError:
        return None
    if len(body) < LINES_TO_LOOK_AT:
        return None
    cells = fast_cells(text.split("\n", top.line)[top.line], top.separator, len(top.header))
    if cells is None:
        return None
    lines = np.arange(top.line + 1, top.line + 1 + len(cells))
    return without_blanks(Table(tuple(top.header), top.line, lines, cells), where)


def parse_with_care(text: str, where: str) -> Table:
    """The table in this text, read line by line: unambiguous content is accepted, and errors are reported.

    Raises:
        MeasurementError: as `parse`.
    """
    top, body = _top(text, where)
    called = [name or str(k + 1) for k, name in enumerate(top.header)]
    numbers = read_rows(body, top.separator, called, where, tolerant=False)
    return without_blanks(Table(tuple(top.header), top.line, numbers.lines, numbers.cells), where)


class Top(NamedTuple):
    """The header, its line, and the separator of the cells."""

    line: int
    header: list[str]
    separator: str


def _top(text: str, where: str) -> tuple[Top, list[tuple[int, str]]]:
    """The header, and the numbered rows below it."""
    numbered = _content(text, where)
    separator, numbered = _announced_separator(numbered)
    (line, header_text), body = numbered[0], numbered[1:]
    at = f"{where}:{line}"
    if not body:
        raise MeasurementError(at, "header only, no row of numbers.", "A trace needs two rows.",
                               "Log it again, or delete the file.")  # fmt: skip
    separator = separator or _separator(header_text, [row for _, row in body[:LINES_TO_LOOK_AT]], at)
    header = [cell.strip() for cell in quoted_cells(header_text, separator, at)]
    named = [cell for cell in header if cell]
    if named and all(NUMBER.fullmatch(cell.replace(",", ".")) for cell in named):
        raise MeasurementError(at, f"numbers where the header must be: '{', '.join(named)[:60]}'.",
                               "The first line that is no comment must name the columns.",
                               "Add a header such as 'time [s],voltage [V]'.")  # fmt: skip
    return Top(line, header, separator), body


def _encoding(raw: bytes) -> str:
    for mark, name in _BOMS:
        if raw.startswith(mark):
            return name
    head = raw[:2000]
    even, odd = head[0::2].count(0), head[1::2].count(0)
    if max(even, odd) > 0.45 * len(head) and min(even, odd) == 0:
        return "utf-16-le" if odd > even else "utf-16-be"
    try:
        _ = raw.isascii() or raw.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"  # Excel's encoding in western Europe; its digits are the same
    return "utf-8"


def _not_text(where: str, found: str) -> MeasurementError:
    return MeasurementError(where, found, "A CSV must be text (UTF-8, UTF-16 or Windows-1252).",
                            "Export it as CSV again.")  # fmt: skip


def _content(text: str, where: str) -> list[tuple[int, str]]:
    lines = text.split("\n")
    numbered = []
    for k, line in enumerate(lines, 1):
        bare = line.lstrip()
        if bare and (not bare.startswith(("#", '"#')) or EXCEL_ERROR.match(bare)):
            numbered.append((k, line))
    if not numbered:
        raise MeasurementError(where, "the file is empty.", "A trace needs a header and two rows.",
                               "Log it again, or delete the file.")  # fmt: skip
    return numbered


def _announced_separator(numbered: list[tuple[int, str]]) -> tuple[str | None, list[tuple[int, str]]]:
    """Excel's own first line, `sep=;`."""
    match = re.fullmatch(r'"?sep=([,;\t])"?', numbered[0][1].rstrip(" "))
    return (match[1], numbered[1:]) if match and len(numbered) > 1 else (None, numbered)


def _separator(header: str, rows: Sequence[str], at: str) -> str:
    """The one separator that gives equally many cells in header and first rows, two at least."""
    counts = {s: _count(header, s) for s in SEPARATORS}
    possible = [s for s in SEPARATORS if counts[s] > 1]
    if not possible:
        raise MeasurementError(at, f"only one column: '{header.strip()[:60]}'.",
                               "A trace needs time and at least one channel, separated by comma, semicolon or tab.",
                               "Write the header as 'time [s],voltage [V]'.")  # fmt: skip
    fitting = [s for s in possible if all(_count(row, s) == counts[s] for row in rows)]
    if len(fitting) > 1:
        raise MeasurementError(at, f"both {fitting[0]!r} and {fitting[1]!r} could separate the cells.",
                               "The separator must be unambiguous.", "Use only one of them in this file.")  # fmt: skip
    return fitting[0] if fitting else max(possible, key=lambda s: counts[s])


def _count(row: str, separator: str) -> int:
    """Number of cells in a row; quotes are not interpreted."""
    try:
        return len(next(csv.reader([row], delimiter=separator))) if '"' in row else row.count(separator) + 1
    except csv.Error:
        return 0


def without_blanks(table: Table, where: str) -> Table:
    """Drop rows without any number, and columns with neither name nor number, which spreadsheets add."""
    filled = np.isfinite(table.cells)
    for k, name in enumerate(table.header):
        if not name and filled[:, k].any():
            line = f" in line {table.header_line}" if table.header_line else ""
            at = table.at(where, int(np.argmax(filled[:, k])))
            raise MeasurementError(at, f"column {k + 1} holds numbers but has no name.",
                                   "Every column needs a header 'quantity [unit]'.",
                                   f"Name it{line}, or delete the column.")  # fmt: skip
    rows, columns = filled.any(axis=1), np.array([bool(name) for name in table.header])
    if rows.all() and columns.all():
        return table  # without a copy
    header = tuple(name for name in table.header if name)
    return replace(table, header=header, lines=table.lines[rows], cells=table.cells[rows][:, columns])
