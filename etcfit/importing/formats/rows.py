"""Rows of numbers within a text: where they begin, what parts their cells, which decimal mark they have."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...errors import MeasurementError
from ...rig.fast_table import GROUPED, fast_cells
from ...rig.table import HUGE

SEPARATORS = ("\t", ";", ",")
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
# what instruments write where a sample was beyond the range, or none came
_NONE = frozenset({"", "∞", "-∞", "+∞", "inf", "-inf", "+inf", "nan", "ol", "over", "overload", "#n/a", "n/a", "---"})
_INSTANT = re.compile(r"(\d{1,4}[-/.]\d\d?[-/.]\d{1,4}[ T])?(\d\d?):(\d\d):(\d\d([.,]\d+)?)Z?")
_DAY = 86400.0  # s
_ROWS = 3  # in a row make a body


@dataclass(frozen=True)
class Body:
    """Where the rows are.

    Args:
        first: line of the first, counted from 0.
        separator: between cells.
        width: cells in a row.
    """

    first: int
    separator: str
    width: int


class Numbers(NamedTuple):
    """What the rows hold.

    Args:
        cells: shape (n, width); NaN where there is no number.
        units: that reading the cells has settled; "" elsewhere.
        remarks: what had to be decided.
        losses: rows that were left out.
    """

    cells: np.ndarray
    units: tuple[str, ...]
    remarks: tuple[str, ...]
    losses: tuple[str, ...] = ()


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, quotes off."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def is_number(cell: str) -> bool:
    """True for a number with either decimal mark."""
    return _NUMBER.fullmatch(cell) is not None


def find_body(lines: Sequence[str], where: str) -> Body:
    """The first lines that are rows of equally many numbers.

    Raises:
        MeasurementError: there are none.
    """
    filled = [(k, line) for k, line in enumerate(lines) if line.strip()]
    for start in range(len(filled) - min(_ROWS, len(filled)) + 1):
        block = filled[start : start + _ROWS]
        for separator in SEPARATORS:
            rows = [cells_of(line, separator) for _, line in block]
            if len({len(row) for row in rows}) == 1 and all(_is_row(row) for row in rows):
                return Body(block[0][0], separator, len(rows[0]))
    raise MeasurementError(where, "no rows of numbers in it.",
                           "Cells must be parted by comma, semicolon or tab, equally many in each row.",
                           "Export it again as CSV, with a header.")  # fmt: skip


def _is_row(cells: Sequence[str]) -> bool:
    """Two numbers or more, or one beside an instant, and no words."""
    numbers = sum(is_number(cell) for cell in cells)
    instants = sum(_INSTANT.fullmatch(cell) is not None for cell in cells)
    return numbers + instants >= 2 and numbers > 0


def read_body(lines: Sequence[str], body: Body, where: str) -> Numbers:
    """The numbers below the header. An instant becomes seconds since the first one.

    Raises:
        MeasurementError: a row of another length, words among the numbers, or marks that may part thousands.
    """
    plain = fast_cells("\n".join(lines[body.first :]), body.separator, body.width, HUGE)
    if plain is not None:
        return Numbers(plain, ("",) * body.width, ())
    numbered = [(k + 1, cells_of(lines[k], body.separator)) for k in range(body.first, len(lines)) if lines[k].strip()]
    cut_off = len(numbered) > _ROWS and len(numbered[-1][1]) < body.width  # the power failed, or the card was full
    numbered = numbered[:-1] if cut_off else numbered
    for line, cells in numbered:
        if len(cells) != body.width:
            raise MeasurementError(f"{where}:{line}", f"{len(cells)} cells found.",
                                   f"The rows above have {body.width}, so must every row.",
                                   "Delete the line, or split the file there.")  # fmt: skip
    columns, remarks = [], []
    mark = _decimal_mark(numbered, body.separator, where)
    for k in range(body.width):
        values, remark = _values([(line, cells[k]) for line, cells in numbered], mark, k, where)
        columns.append(values)
        remarks += [remark] if remark else []
    units = ["s" if _are_instants(numbered, k) else "" for k in range(body.width)]
    losses = ("the last row is cut off and left out",) if cut_off else ()
    return Numbers(np.array(columns).T, tuple(units), tuple(remarks), losses)


def _are_instants(numbered: list[tuple[int, list[str]]], k: int) -> bool:
    return all(_INSTANT.fullmatch(cells[k]) for _, cells in numbered)


def _decimal_mark(numbered: list[tuple[int, list[str]]], separator: str, where: str) -> str:
    if separator == ",":
        return "."
    commas = [(line, cell) for line, cells in numbered for cell in cells if "," in cell and is_number(cell)]
    points = [(line, cell) for line, cells in numbered for cell in cells if "." in cell and is_number(cell)]
    if commas and points:
        raise MeasurementError(f"{where}:{commas[0][0]}", f"'{commas[0][1]}', while other cells have a point.",
                               "One file must use one decimal mark and no thousands separator.",
                               "Export it again without thousands separators.")  # fmt: skip
    if commas and all(GROUPED[","].fullmatch(cell) for _, cell in commas):
        raise MeasurementError(f"{where}:{commas[0][0]}", f"'{commas[0][1]}': the comma may part thousands.",
                               "The decimal mark must be unambiguous.",
                               "Export it with a decimal point, or with more digits.")  # fmt: skip
    return "," if commas else "."


def _values(cells: Sequence[tuple[int, str]], mark: str, k: int, where: str) -> tuple[np.ndarray, str]:
    """One column, and what had to be decided about it."""
    if all(_INSTANT.fullmatch(text) for _, text in cells):
        return _seconds([text for _, text in cells]), f"column {k + 1}: instants made seconds since the first"
    texts = [text.replace(",", ".") if mark == "," else text for _, text in cells]
    try:
        return np.array([float(text) if text else np.nan for text in texts]), ""
    except ValueError:
        return _with_care(cells, texts, k, where)


def _with_care(cells: Sequence[tuple[int, str]], texts: Sequence[str], k: int, where: str) -> tuple[np.ndarray, str]:
    """A column in which something is no number."""
    odd = [(line, text) for (line, _), text in zip(cells, texts, strict=True) if not is_number(text)]
    words = [(line, text) for line, text in odd if text.casefold() not in _NONE]
    if words and 2 * len(words) < len(texts):
        raise MeasurementError(f"{where}:{words[0][0]}", f"'{words[0][1][:40]}' in column {k + 1}.",
                               "Below the header every cell must be a number or empty.",
                               "Correct the cell, or empty it for a gap.")  # fmt: skip
    if words:
        return np.full(len(texts), np.nan), f"column {k + 1}: words, no numbers"
    lost = sum(bool(text) for _, text in odd)
    values = np.array([float(text) if is_number(text) else np.nan for text in texts])
    return values, f"column {k + 1}: {lost} samples beyond the range ('{odd[0][1]}') are gaps" if lost else ""


def _seconds(texts: Sequence[str]) -> np.ndarray:
    """Seconds since the first instant; what falls back began another day."""
    found = [match for text in texts if (match := _INSTANT.fullmatch(text))]
    clock = np.array([3600.0 * int(m[2]) + 60.0 * int(m[3]) + float(m[4].replace(",", ".")) for m in found])
    days = np.concatenate(([0.0], np.cumsum(np.diff(clock) < -0.5 * _DAY)))
    return clock + _DAY * days - clock[0]


def refuse_spoilt(lines: Sequence[str], first: int, body: Body, where: str) -> None:
    """Refuse a row between the header and the body that is none because of a cell: rows must not be lost unsaid.

    Args:
        lines: of the file.
        first: line below the header, counted from 0.
        body: where the rows begin.
        where: what messages call the file.
    Raises:
        MeasurementError: naming the line and the cell.
    """
    for k in range(first, body.first):
        cells = cells_of(lines[k], body.separator)
        odd = [cell for cell in cells if cell and not is_number(cell)]
        if len(cells) == body.width and odd and len(odd) < len([cell for cell in cells if cell]):
            raise MeasurementError(f"{where}:{k + 1}", f"'{odd[0][:40]}' among the numbers.",
                                   "Below the header every cell must be a number or empty.",
                                   "Correct the cell, or empty it for a gap.")  # fmt: skip
