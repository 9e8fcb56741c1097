"""A CSV file as a table of numbers: encoding, separator and decimal mark found out, every oddity refused by line.

Accepted where unambiguous: comma, semicolon or tab; decimal comma; UTF-8 with or without BOM, UTF-16, Windows-1252;
any line ending; Excel's `sep=;`; quoted cells. Lines that begin with `#` and blank lines are skipped but counted.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..errors import MeasurementError
from .fast_table import GROUPED, LINES_TO_LOOK_AT, fast_cells

SEPARATORS = (",", ";", "\t")
HUGE = 1e100  # no reading is larger, and no unit turns a smaller one into infinity
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
PLAIN = frozenset("0123456789+-.eE,; \t")  # nothing that float() would take and a reader would not
LINES_OF_A_TOP = 200  # comments and header; a file with more above its rows is read the careful way
CONTROL = bytes((*range(0x09), *range(0x0E, 0x20), 0x7F))  # all but tab and line ends
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
    """Header cells as written, numbers below them.

    Args:
        header: shape (m,).
        header_line: where the header stands in the file, counted from 1; 0 where there is no file.
        lines: where each row stands in the file, shape (n,).
        cells: shape (n, m); NaN where the cell is empty, finite elsewhere.
        row_mark: what a message puts between the table's name and the number of a row.
        losses: rows that were left out because they are damaged, each in a sentence.
    """

    header: tuple[str, ...]
    header_line: int
    lines: np.ndarray
    cells: np.ndarray
    row_mark: str = ":"
    losses: tuple[str, ...] = ()

    def head(self, where: str) -> str:
        """Where the header stands, for a message."""
        return f"{where}:{self.header_line}" if self.header_line else where

    def at(self, where: str, row: int) -> str:
        """Where a row stands, for a message."""
        return f"{where}{self.row_mark}{self.lines[row]}"


def decode(raw: bytes, where: str) -> str:
    """The text in these bytes, line ends made `\\n`.

    Raises:
        MeasurementError: it is no text.
    """
    try:
        text = raw.decode(_encoding(raw))
    except UnicodeDecodeError as err:
        raise _not_text(where, f"the bytes at offset {err.start} are no {err.encoding} text.") from err
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if control := _control(text):
        line = text.count("\n", 0, control.start()) + 1
        raise _not_text(f"{where}:{line}", f"control character {control[0]!r} found.")
    return text


def parse(text: str, where: str) -> Table:
    """The table in this text.

    A plain one is read fast, any other with care; the table is the same, and so are the messages.

    Raises:
        MeasurementError: empty, header only, rows of unequal length, or anything but numbers below the header.
    """
    table = parse_plain(text, where)
    return parse_with_care(text, where) if table is None else table


def parse_plain(text: str, where: str) -> Table | None:
    """The table in this text where a fast reader is sure of it; else None, and no message.

    Raises:
        MeasurementError: numbers in a column without a name.
    """
    try:
        top, body = _top("\n".join(text.split("\n", LINES_OF_A_TOP)[:LINES_OF_A_TOP]), where)
    except MeasurementError:
        return None
    if len(body) < LINES_TO_LOOK_AT:
        return None
    cells = fast_cells(text.split("\n", top.line)[top.line], top.separator, len(top.header), HUGE)
    if cells is None:
        return None
    lines = np.arange(top.line + 1, top.line + 1 + len(cells))
    return without_blanks(Table(tuple(top.header), top.line, lines, cells), where)


def parse_with_care(text: str, where: str) -> Table:
    """The table in this text, line by line: takes all that is unambiguous, and says what is wrong with the rest.

    Raises:
        MeasurementError: as `parse`.
    """
    top, body = _top(text, where)
    rows = _rows(body, top.separator, len(top.header), where)
    lines = np.array([line for line, _ in body])
    cells = _numbers(rows, lines, top.header, top.separator, where)
    return without_blanks(Table(tuple(top.header), top.line, lines, cells), where)


class Top(NamedTuple):
    """The header, the line it stands in, and what separates the cells."""

    line: int
    header: list[str]
    separator: str


def _top(text: str, where: str) -> tuple[Top, list[tuple[int, str]]]:
    """What the rows below it need to be read, and those rows, numbered."""
    numbered = _content(text, where)
    separator, numbered = _announced_separator(numbered)
    (line, header_text), body = numbered[0], numbered[1:]
    at = f"{where}:{line}"
    if not body:
        raise MeasurementError(at, "header only, no row of numbers.", "A trace needs two rows.",
                               "Log it again, or delete the file.")  # fmt: skip
    separator = separator or _separator(header_text, [row for _, row in body[:LINES_TO_LOOK_AT]], at)
    header = [cell.strip() for cell in _split(header_text, separator, at)]
    _refuse_numbers_as_header(header, at)
    return Top(line, header, separator), body


def _control(text: str) -> re.Match[str] | None:
    """The first control character that no text has; a long text without any is not searched letter by letter."""
    raw = text.encode("utf-8") if text.isascii() else b""
    if raw and len(raw.translate(None, CONTROL)) == len(raw):
        return None
    return re.search(rf"[{CONTROL.decode('ascii')}]", text)


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
        return "cp1252"  # what Excel writes in western Europe; digits are the same in it
    return "utf-8"


def _not_text(where: str, found: str) -> MeasurementError:
    return MeasurementError(where, found, "A CSV must be text (UTF-8, UTF-16 or Windows-1252).",
                            "Export it as CSV again.")  # fmt: skip


def _content(text: str, where: str) -> list[tuple[int, str]]:
    lines = text.split("\n")
    numbered = [(k, s) for k, s in enumerate(lines, 1) if s and not _is_comment(s)]
    if not numbered:
        raise MeasurementError(where, "the file is empty.", "A trace needs a header and two rows.",
                               "Log it again, or delete the file.")  # fmt: skip
    return numbered


def _is_comment(line: str) -> bool:
    text = line.lstrip()
    return not text or (text.startswith(("#", '"#')) and not EXCEL_ERROR.match(text))


def _announced_separator(numbered: list[tuple[int, str]]) -> tuple[str | None, list[tuple[int, str]]]:
    """Excel's own first line, `sep=;`."""
    match = re.fullmatch(r'"?sep=([,;\t])"?', numbered[0][1].rstrip(" "))
    return (match[1], numbered[1:]) if match and len(numbered) > 1 else (None, numbered)


def _separator(header: str, rows: Sequence[str], at: str) -> str:
    """The one separator that cuts header and first rows into equally many cells, two at least."""
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
    """Cells in a row, quotes taken as they come."""
    try:
        return len(next(csv.reader([row], delimiter=separator))) if '"' in row else row.count(separator) + 1
    except csv.Error:
        return 0


def _split(row: str, separator: str, where: str) -> list[str]:
    if '"' not in row:
        return row.split(separator)
    try:
        return next(csv.reader([row], delimiter=separator, strict=True))
    except (csv.Error, StopIteration) as err:
        raise MeasurementError(where, f"broken quotes: {row.strip()[:60]!r}.", "Quotes must come in pairs.",
                               "Remove them; numbers need none.") from err  # fmt: skip


def _refuse_numbers_as_header(header: list[str], where: str) -> None:
    named = [cell for cell in header if cell]
    if named and all(NUMBER.fullmatch(cell.replace(",", ".")) for cell in named):
        raise MeasurementError(where, f"numbers where the header must be: '{', '.join(named)[:60]}'.",
                               "The first line that is no comment must name the columns.",
                               "Add a header such as 'time [s],voltage [V]'.")  # fmt: skip


def _rows(body: list[tuple[int, str]], separator: str, width: int, where: str) -> list[list[str]]:
    rows = [row.split(separator) if '"' not in row else _split(row, separator, f"{where}:{line}") for line, row in body]
    for (line, _), row in zip(body, rows, strict=True):
        if len(row) != width:
            comma = " Decimal commas need ';' or a tab between the cells." if separator == "," else ""
            raise MeasurementError(f"{where}:{line}", f"{len(row)} cells found.",
                                   f"The header has {width}, so must every row.",
                                   f"Leave a cell empty for a gap, but keep its separator.{comma}")  # fmt: skip
    return rows


def _numbers(rows: list[list[str]], lines: np.ndarray, header: list[str], separator: str, where: str) -> np.ndarray:
    cells = list(chain.from_iterable(rows))
    mark = _decimal_mark(cells, separator, lines, len(header), where)
    if mark == ",":
        cells = [cell.replace(",", ".") for cell in cells]
    shape = (len(rows), len(header))
    if PLAIN.issuperset("".join(cells)):
        try:
            return _finite(np.array([float(c) if c else np.nan for c in cells]), cells).reshape(shape)
        except ValueError:
            pass  # some cell is odd, or blank but not empty: look at each
    return np.array([_number(c, k, lines, header, where) for k, c in enumerate(cells)]).reshape(shape)


def _finite(values: np.ndarray, cells: list[str]) -> np.ndarray:
    """Refuse 1e999, which float() takes for infinity."""
    if np.any(np.abs(values) > HUGE):
        raise ValueError(cells[int(np.nanargmax(np.abs(values)))])
    return values


def _number(cell: str, k: int, lines: np.ndarray, header: list[str], where: str) -> float:
    number = number_in(cell)
    if number is None:
        row, column = divmod(k, len(header))
        raise no_number(cell, header[column], f"{where}:{lines[row]}")
    return number


def number_in(cell: str) -> float | None:
    """The number that a cell holds, NaN where it is empty; None where it holds anything else."""
    text = cell.strip()
    if not text:
        return np.nan
    return float(text) if NUMBER.fullmatch(text) and abs(float(text)) <= HUGE else None


def no_number(cell: str, column: str, place: str) -> MeasurementError:
    """The message on a cell that is neither number nor empty."""
    return MeasurementError(place, f"'{cell.strip()[:40]}' in column '{column}'.",
                            "Below the header every cell must be a finite number or empty.",
                            "Correct the cell, or leave it empty for a gap.")  # fmt: skip


def _decimal_mark(cells: list[str], separator: str, lines: np.ndarray, width: int, where: str) -> str:
    """The decimal mark; thousands separators are refused wherever they could be meant."""
    point, comma = (next((k for k, c in enumerate(cells) if mark in c), None) for mark in ".,")
    if comma is None and (point is None or separator == ","):
        return "."
    k = comma if comma is not None else point
    assert k is not None
    at = f"{where}:{lines[k // width]}"
    if comma is not None and point is not None:
        raise MeasurementError(at, f"'{cells[k].strip()[:40]}', while other cells use a decimal point.",
                               "One file must use one decimal mark and no thousands separator.",
                               "Export it again without thousands separators.")  # fmt: skip
    mark = "." if comma is None else ","
    marked = [c.strip() for c in cells if mark in c]
    if all(GROUPED[mark].fullmatch(c) for c in marked):
        raise MeasurementError(at, f"'{cells[k].strip()[:40]}': the '{mark}' may be a decimal mark or part thousands.",
                               "The decimal mark must be unambiguous.",
                               "Separate cells by ',' and write decimals with a point.")  # fmt: skip
    return mark


def without_blanks(table: Table, where: str) -> Table:
    """Drop what spreadsheets add: rows without any number, and columns with neither name nor number."""
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
        return table  # a long one is not copied
    header = tuple(name for name in table.header if name)
    return replace(table, header=header, lines=table.lines[rows], cells=table.cells[rows][:, columns])
