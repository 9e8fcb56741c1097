"""Turns rows of text into numbers: splits cells, finds the decimal mark, reads times of day, takes gaps as NaN.

`table` uses it for the CSV of a measurement folder: strictly, so that a cell that is no number is refused. `layout`
uses it for the text files of other programs: tolerantly, so that a column of words is no signal, and the text that an
instrument writes in place of a reading is a gap.

There are two readers. `fast_cells` reads plain rows by NumPy's C reader, in a tenth of the time, and returns None where
the rows are not plain. `read_rows` then reads the same rows cell by cell, and either accepts them or reports the error.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import MeasurementError

SEPARATORS = (",", ";", "\t")
BLANKS = " "  # any white space separates the cells
HUGE = 1e100  # larger than any reading; no unit converts a smaller number to infinity
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
PLAIN = frozenset("0123456789+-.eE,; \t")  # without characters that float() accepts and the reader refuses
_EITHER_MARK = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_MARKED = re.compile(r"[+-]?[\d.,]*[.,][\d.,]*([eE][+-]?\d+)?", re.ASCII)
# texts of instruments for a sample beyond the range, or for a missing one
_NONE = frozenset(
    {"", "-", "---", "∞", "-∞", "+∞", "inf", "-inf", "+inf", "nan", "ol", "over", "overload", "#n/a", "n/a"}
)
_INSTANT = re.compile(
    r"(?:\d{1,4}[-/.](?:\d\d?|[A-Za-z]{3})[-/.]\d{1,4}[ T]+)?(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d+)?)"
    r"\s*(?P<half>[AaPp][Mm])?(?:Z|[+-]\d\d:?\d\d)?"
)
_LAP = re.compile(r"(?P<m>\d{1,3}):(?P<s>\d\d[.,]\d+)")  # minutes and seconds, as in stop watches and spreadsheets
_HOUR, _DAY = 3600.0, 86400.0  # s
_FEW = 3  # number of rows above which a short last row counts as cut off
LINES_TO_LOOK_AT = 20
GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}", re.ASCII) for mark in ".,"}
_OF_NUMBERS = "0123456789+-eE \n"  # characters of plain rows, besides a decimal mark and the separator


class Numbers(NamedTuple):
    """The numbers of rows."""

    cells: np.ndarray  # shape (n, width); NaN where there is no number
    units: tuple[str, ...]  # units found while reading the cells; "" elsewhere
    lines: np.ndarray  # line of each row, shape (n,), counted from 1
    remarks: tuple[str, ...] = ()  # the assumptions that were made
    losses: tuple[str, ...] = ()  # a sentence for rows or cells that were left out


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line without quotes and blanks around them."""
    if separator == BLANKS:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def quoted_cells(line: str, separator: str, where: str) -> list[str]:
    """The cells of a line unchanged.

    Raises:
        MeasurementError: an unpaired quote.
    """
    if '"' not in line:
        return line.split() if separator == BLANKS else line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, strict=True))
    except (csv.Error, StopIteration) as err:
        raise MeasurementError(where, f"broken quotes: {line.strip()[:60]!r}.", "Quotes must come in pairs.",
                               "Remove them; numbers need none.") from err  # fmt: skip


def is_number(cell: str) -> bool:
    """True for a number with either decimal mark."""
    return _EITHER_MARK.fullmatch(cell) is not None


def is_instant(cell: str) -> bool:
    """True for a time of day with or without a date, and for minutes with seconds and their fraction."""
    return _INSTANT.fullmatch(cell) is not None or _LAP.fullmatch(cell) is not None


def is_gap(cell: str) -> bool:
    """True for a cell without a reading: empty, nan, inf, OL and the like."""
    return cell.casefold() in _NONE


def number_in(cell: str) -> float | None:
    """The number that a cell holds, NaN where it is empty; None where it holds anything else."""
    text = cell.strip()
    if not text:
        return np.nan
    return float(text) if NUMBER.fullmatch(text) and abs(float(text)) <= HUGE else None


def not_a_number_error(cell: str, column: str, place: str) -> MeasurementError:
    """The error to raise for a cell that is neither a number nor empty."""
    return MeasurementError(place, f"'{cell.strip()[:40]}' in column '{column}'.",
                            "Below the header every cell must be a finite number or empty.",
                            "Correct the cell, or leave it empty for a gap.")  # fmt: skip


def read_rows(
    rows: Sequence[tuple[int, str]],
    separator: str,
    names: Sequence[str],
    where: str,
    *,
    tolerant: bool,
    short: str = "",
) -> Numbers:
    """The numbers of rows. A column of instants is converted to seconds since the first one.

    Args:
        rows: line, counted from 1, and its text; not blank.
        names: of the columns, for messages; "" where one has none.
        tolerant: whether texts of instruments in place of a number are gaps, and columns of words are left out.
        short: treatment of a row with too few cells: "" is an error, "fill" takes its last cells as empty, "drop"
            leaves it out as damaged, and likewise a cell that is no number.
    Raises:
        MeasurementError: a row of another length, a cell that is no number, or marks that may separate thousands.
    """
    plain = None if short == "drop" else fast_cells("\n".join(text for _, text in rows), separator, len(names))
    if plain is not None:
        return Numbers(plain, ("",) * len(names), np.array([line for line, _ in rows]))
    split = [(line, quoted_cells(text, separator, f"{where}:{line}")) for line, text in rows]
    split, losses = _of_one_width(split, separator, len(names), where, tolerant, short)
    lines = np.array([line for line, _ in split], dtype=int)
    mark = _decimal_mark(split, separator, where, tolerant)
    columns, units, remarks = [], [], []
    for k, name in enumerate(names):
        texts = [cells[k].strip() for _, cells in split]
        called = name or str(k + 1)
        if _are_instants(texts, lines, called, where):
            columns.append(_seconds(texts))
            units.append("s")
            remarks.append(f"column {k + 1}: instants made seconds since the first")
            continue
        values, said = _values(texts, lines, mark, called, where, tolerant, short == "drop")
        columns.append(values)
        units.append("")
        (losses if short == "drop" else remarks).extend(filter(None, (said,)))
    return Numbers(
        np.array(columns).T.reshape(len(split), len(names)), tuple(units), lines, tuple(remarks), tuple(losses)
    )


def _of_one_width(
    rows: list[tuple[int, list[str]]], separator: str, width: int, where: str, tolerant: bool, short: str
) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """The rows of this width, and sentences on those left out."""
    losses = []
    if short == "fill":
        rows = [(line, [*cells, *[""] * width][:width] if not any(cells[width:]) else cells) for line, cells in rows]
    if short == "drop":
        few = [line for line, cells in rows if len(cells) < width]
        rows = [(line, cells[:width]) for line, cells in rows if len(cells) >= width]
        if few:
            shown = ", ".join(map(str, few[:5])) + (", and more" if len(few) > 5 else "")
            losses.append(f"rows with too few cells are left out: {len(few)}, in lines {shown}")
    if tolerant and len(rows) > _FEW and len(rows[-1][1]) < width:  # the power failed, or the card was full
        rows = rows[:-1]
        losses.append("the last row is cut off and left out")
    for line, cells in rows:
        if len(cells) != width:
            comma = " Decimal commas need ';' or a tab between the cells." if separator == "," else ""
            raise MeasurementError(f"{where}:{line}", f"{len(cells)} cells found.",
                                   f"The header has {width}, so must every row.",
                                   f"Leave a cell empty for a gap, but keep its separator.{comma}")  # fmt: skip
    return rows, losses


def _decimal_mark(rows: Sequence[tuple[int, list[str]]], separator: str, where: str, tolerant: bool) -> str:
    """The decimal mark; a mark that may be a thousands separator is refused."""
    marked = [(line, cell.strip()) for line, cells in rows for cell in cells if "," in cell or "." in cell]
    marked = [(line, cell) for line, cell in marked if _MARKED.fullmatch(cell)]
    point, comma = (next((each for each in marked if mark in each[1]), None) for mark in ".,")
    if comma is None and (point is None or separator == "," or tolerant):
        return "."
    line, cell = comma or point or (0, "")
    if comma is not None and point is not None:
        raise MeasurementError(f"{where}:{line}", f"'{cell[:40]}', while other cells use a decimal point.",
                               "One file must use one decimal mark and no thousands separator.",
                               "Export it again without thousands separators.")  # fmt: skip
    mark = "." if comma is None else ","
    if all(GROUPED[mark].fullmatch(each) for _, each in marked):
        raise MeasurementError(f"{where}:{line}",
                               f"'{cell[:40]}': the '{mark}' may be a decimal mark or part thousands.",
                               "The decimal mark must be unambiguous.",
                               "Separate cells by ',' and write decimals with a point.")  # fmt: skip
    return mark


def _values(
    texts: Sequence[str], lines: np.ndarray, mark: str, called: str, where: str, tolerant: bool, drop: bool
) -> tuple[np.ndarray, str]:
    """The values of one column, and a remark on an assumption."""
    texts = [text.replace(",", ".") for text in texts] if mark == "," else texts
    if PLAIN.issuperset("".join(texts)):
        try:
            values = np.array([float(text) if text else np.nan for text in texts])
            if not np.any(np.abs(values) > HUGE):
                return values, ""
        except ValueError:
            pass  # some cell is no number: each is examined below
    found = [number_in(text) for text in texts]
    odd = [k for k, value in enumerate(found) if value is None]
    words = [k for k in odd if not (tolerant and is_gap(texts[k]))]
    values = np.array([np.nan if value is None else value for value in found])
    if not tolerant or (words and not drop and 2 * len(words) < len(texts)):
        if words:
            raise not_a_number_error(texts[words[0]], called, f"{where}:{lines[words[0]]}")
        return values, ""
    said = ""
    lost = [texts[k] for k in odd if texts[k]]
    if drop:
        said = f"'{called}': {len(odd)} cells without a number are gaps" if 0 < 2 * len(odd) < len(texts) else ""
    elif words:
        values, said = np.full(len(texts), np.nan), f"column '{called}': words, no numbers"
    elif lost:
        said = f"column '{called}': {len(lost)} samples beyond the range ('{lost[0]}') are gaps"
    return values, said


def _are_instants(texts: Sequence[str], lines: np.ndarray, called: str, where: str) -> bool:
    """True for a column of instants and empty cells.

    Raises:
        MeasurementError: most cells are instants, and another one is not.
    """
    if not any(map(is_instant, texts[:_FEW])):
        return False
    odd = [k for k, text in enumerate(texts) if text and not is_instant(text)]
    if odd and 2 * len(odd) < len(texts):
        raise not_a_number_error(texts[odd[0]], called, f"{where}:{lines[odd[0]]}")
    return not odd


def _seconds(texts: Sequence[str]) -> np.ndarray:
    """Seconds since the first instant, NaN where there is none; a fall means the next day, or hour."""
    found = [(k, match) for k, text in enumerate(texts) if (match := _INSTANT.fullmatch(text) or _LAP.fullmatch(text))]

    def seconds_of_day(match: re.Match[str]) -> float:
        said = match.groupdict()
        hour = int(said.get("h", 0))
        hour = hour % 12 + 12 * (said["half"].casefold() == "pm") if said.get("half") else hour
        return _HOUR * hour + 60.0 * int(said["m"]) + float(said["s"].replace(",", "."))

    clock = np.array([seconds_of_day(match) for _, match in found])
    turn = _DAY if any("h" in match.groupdict() for _, match in found) else _HOUR
    turns = np.concatenate(([0.0], np.cumsum(np.diff(clock) < -0.5 * turn)))
    out = np.full(len(texts), np.nan)
    out[[k for k, _ in found]] = np.round(clock + turn * turns - clock[0], 9)
    return out


def fast_cells(body: str, separator: str, width: int) -> np.ndarray | None:
    """The numbers in these rows, shape (n, width), NaN where a cell is empty; None where the rows are not plain.

    Plain rows have a number or nothing in each of `width` cells and nothing between them: no comment, quote or blank
    line, and a decimal mark that cannot part thousands.
    """
    mark = _plain_mark(body, separator) if body.isascii() else None
    if mark is None:
        return None
    rows, part = body.replace(mark, ".").rstrip("\n").encode("ascii"), separator.encode("ascii")
    lines, foreign = rows.count(b"\n") + 1, rows.translate(None, _OF_NUMBERS.encode("ascii") + b"." + part)
    blank = not rows or rows.startswith(b"\n") or b"\n\n" in rows
    if blank or foreign or rows.count(part) != lines * (width - 1):
        return None
    cells = _numbers(rows, separator)
    if cells is None:  # an empty cell is no number to NumPy
        mark_of_cells = re.escape(part)
        empty = rb"(?m)(?:^|(?<=" + mark_of_cells + rb")) *(?=" + mark_of_cells + rb"|$)"
        cells = _numbers(re.sub(empty, b"nan", rows), separator)
    return cells if cells is not None and cells.shape == (lines, width) and not np.any(np.abs(cells) > HUGE) else None


def _plain_mark(body: str, separator: str) -> str | None:
    """`.` or `,`; None where a mark may separate thousands, which the careful reader decides from every cell."""
    if separator == ",":
        return "."
    point, comma = "." in body, "," in body
    if not (point or comma):
        return "."
    mark = "," if comma else "."
    cells = (cell.strip() for line in body.split("\n", LINES_TO_LOOK_AT)[:-1] for cell in line.split(separator))
    plain = any(mark in cell and not GROUPED[mark].fullmatch(cell) for cell in cells)
    return mark if plain and not (point and comma) else None


def _numbers(rows: bytes, separator: str) -> np.ndarray | None:
    """The numbers of the rows; None where a cell is no number or rows have unequal width."""
    try:
        return np.loadtxt(io.BytesIO(rows), delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        return None
