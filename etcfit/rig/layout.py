"""Finds the layout of a text: its rows of numbers, and the names and units of their columns.

    lines above the header, a header, a row of units, blank lines       MoTeC, AiM, PicoScope, spreadsheets, loggers
    long names, units, short names                                      a header of three rows
    % 1  time [s]                                                       names in comments, cells parted by blanks
    t,25618580,PWM,-20                                                  a label before each number (serial plotters)
    [Channel Information] ids, names, units, [Channel Data] rows        HP Tuners
    %DataLog%, Channel : ..., Type : ..., rows of whole numbers         Haltech NSP
    names, units, rows parted by tabs, MARK lines among them            MegaLogViewer's .msl

Source: HP Tuners and Haltech by public readers and writers of their exports; EFI Analytics, MegaLogViewer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MeasurementError
from .rows import BLANKS, Numbers, cells_of, is_gap, is_instant, is_number, read_rows
from .units import is_unit_text

# beginnings of lines that are no rows: comments of any program, PuTTY's mark of a new log, MegaLogViewer's marks
_COMMENT = re.compile(r'\s*("?#|//|%(?!\s*[,;\t])|=~=~|MARK \d)')  # a row of units may begin with per cent
_COMMENT_MARKS = '#%/ \t"'
_BLOCK = 3  # consecutive rows that make a body
_MOSTLY = 0.5  # least share of numbers in a row: settings above a table may be rows of as many cells
_TRIED = ("\t", ";", ",")
_NUMBERED = re.compile(r"(?P<number>\d+)[.:)]?\s+(?P<name>\S.*)")  # a list of names in comments
_TOKEN = re.compile(r"[^\s\[\](){}]+(?:\s?[\[(][^\[\]()]*[\])])?")  # a name, its unit in brackets with it
_UNIT = "(?:us|ms|s|mV|V|mA|A|deg|°|rad/s|rad|rpm|%)"  # behind a number; parted from it by a blank, it ends the cell
_PAIR = re.compile(
    r"\s*(?P<label>[A-Za-zµ_][\w %/.°-]*?)\s*[:=,;\t ]\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    rf"(?P<unit>{_UNIT}(?=[\s,;]|$)| {_UNIT}(?=\s*(?:[,;\t]|$)))?\s*(?:[,;\t ]|$)"
)

# Haltech's types -> size of one count, and its unit; other types keep their counts without a unit
HALTECH: dict[str, tuple[float, str]] = {
    "Percentage": (0.1, "%"), "BatteryVoltage": (1e-3, "V"), "EngineSpeed": (1.0, "rpm"), "Angle": (0.1, "deg"),
    "Speed": (0.1, "km/h"), "Pressure": (0.1, "kPa"), "AbsPressure": (0.1, "kPa"), "Temperature": (0.1, "K"),
    "Time_us": (1.0, "us"), "Time_ms": (1.0, "ms"), "Current_mA_as_A": (1e-3, "A"), "Current_uA_as_mA": (1e-3, "mA"),
}  # fmt: skip
_NO_READING = 8388607  # values from here on mean in Haltech's logs that a channel has no reading


@dataclass(frozen=True)
class Layout:
    """The layout of a text, which reading the rows needs."""

    names: tuple[str, ...]  # of the columns; "" where there are none
    units: tuple[str, ...]  # of the columns; "" where there are none
    head: int  # the line of the names, counted from 1; 0 where there is none
    first: int  # line of the first row, counted from 0
    separator: str  # between cells
    short: str = ""  # as in `read_rows`
    scales: tuple[float, ...] = ()  # factors of the numbers, column by column; () where there are none
    remark: str = ""  # an assumption that was made; "" where there is none


@dataclass(frozen=True, eq=False)
class TextTable:
    """Named columns of a text."""

    layout: Layout  # its layout
    units: tuple[str, ...]  # unit of each column, including those found while reading
    numbers: Numbers  # the numbers, shape (n, m), and their lines

    @property
    def remarks(self) -> tuple[str, ...]:
        """The assumptions that were made."""
        return tuple(filter(None, (self.layout.remark, *self.numbers.remarks)))


def read_text(text: str, where: str) -> TextTable:
    """The table in a text of any known layout.

    Raises:
        MeasurementError: no rows of numbers, or other text among them.
    """
    lines = text.split("\n")
    for begins, layout_of in LAYOUTS:
        if begins(lines):
            return _read(*layout_of(lines, where), where)
    bare, layout = _pairs(lines) or _with_header(lines, where)
    # a row between the header and the body that one bad cell invalidates must be reported
    for k in range(layout.head, layout.first):
        cells = cells_of(bare[k], layout.separator)
        filled = [cell for cell in cells if cell]
        odd = [cell for cell in filled if not is_number(cell)]
        if len(cells) == len(layout.names) and odd and len(odd) < len(filled):
            raise MeasurementError(f"{where}:{k + 1}", f"'{odd[0][:40]}' among the numbers.",
                                   "Below the header every cell must be a number or empty.",
                                   "Correct the cell, or empty it for a gap.")  # fmt: skip
    return _read(bare, layout, where)


def read_msl(text: str, where: str) -> TextTable:
    """Read MegaLogViewer's text; damaged rows are left out and reported.

    Raises:
        MeasurementError: no header, or no rows of numbers below it.
    """
    lines = text.split("\n")
    head = next((k for k, line in enumerate(lines) if "\t" in line), None)
    required = "An .msl has a line of names, a line of units and rows, parted by tabs."
    mend = "Export it again from MegaLogViewer or TunerStudio, or as CSV."
    if head is None or head + 2 >= len(lines):
        raise MeasurementError(where, "no header of names parted by tabs.", required, mend)
    names, units = (cells_of(lines[k].strip("\r"), "\t") for k in (head, head + 1))
    first = head + 1 if _begins_with_number(lines[head + 1]) else head + 2
    units = [] if first == head + 1 else units
    kept = [line if _begins_with_number(line) else "" for line in lines[first:-1]]
    if not any(kept):
        raise MeasurementError(where, "no row of numbers below its header.", required, mend)
    layout = Layout(tuple(names), _padded(units, len(names)), head + 1, first, "\t", "drop")
    return _read([*lines[:first], *kept], layout, where)


def _begins_with_number(line: str) -> bool:
    return is_number(line.partition("\t")[0].strip())


def _read(lines: Sequence[str], layout: Layout, where: str) -> TextTable:
    rows = [(k + 1, lines[k]) for k in range(layout.first, len(lines)) if lines[k].strip() and not is_comment(lines[k])]
    numbers = read_rows(rows, layout.separator, layout.names, where, tolerant=True, short=layout.short)
    if layout.scales:
        there = np.abs(numbers.cells) < _NO_READING
        numbers = numbers._replace(cells=np.where(there, numbers.cells, np.nan) * np.array(layout.scales))
    units = tuple(a or b for a, b in zip(layout.units, numbers.units, strict=True))
    return TextTable(layout, units, numbers)


def is_comment(line: str) -> bool:
    """True for a line that cannot be a row."""
    return _COMMENT.match(line) is not None


@dataclass(frozen=True)
class _Body:
    """The rows: line of the first, counted from 0; separator of their cells; number of cells."""

    first: int
    separator: str
    width: int


def _with_header(lines: Sequence[str], where: str) -> tuple[list[str], Layout]:
    """The lines without comments, and their layout.

    Raises:
        MeasurementError: there are no rows of numbers.
    """
    bare = ["" if is_comment(line) else line for line in lines]
    body = _find_body(bare, where)
    names, units, head = _header_above(bare, body)
    if not head:
        names, head = _names_in_comments(lines[: body.first], body)
    return bare, Layout(_padded(names, body.width), _padded(units, body.width), head, body.first, body.separator)


def _find_body(lines: Sequence[str], where: str) -> _Body:
    """The first lines that are rows of equally many numbers, with the separator that leaves no words.

    Rows with words and numbers are a body only where no rows of numbers follow.
    """
    filled = [(k, line) for k, line in enumerate(lines) if line.strip()]
    for size, least in ((_BLOCK, _MOSTLY), (_BLOCK, 0.0), (2, 0.0)):
        for start in range(len(filled) - size + 1):
            if body := _body_at([line for _, line in filled[start : start + size]], filled[start][0], least):
                return body
    for start in range(len(filled) - _BLOCK + 1):
        if all(is_number(line.strip()) for _, line in filled[start : start + _BLOCK]):
            return _Body(filled[start][0], "\t", 1)
    raise MeasurementError(where, "no rows of numbers in it.",
                           "Cells must be parted by comma, semicolon, tab or blanks, equally many in each row.",
                           "Export it again as CSV, with a header.")  # fmt: skip


def _body_at(block: Sequence[str], first: int, least: float) -> _Body | None:
    """The body that begins with these lines, if a share above `least` of its filled cells are numbers or instants."""
    best, share = None, least
    for separator in (*_TRIED, BLANKS):
        rows = [cells_of(line, separator) for line in block]
        if len({len(row) for row in rows}) != 1 or not all(map(_is_row, rows)):
            continue
        filled = [cell for row in rows for cell in row if not is_gap(cell)]
        good = sum(is_number(cell) or is_instant(cell) for cell in filled) / len(filled)
        if good > share and (separator != BLANKS or good == 1.0):
            best, share = _Body(first, separator, len(rows[0])), good
    return best


def _is_row(cells: Sequence[str]) -> bool:
    """Whether cells are a row: two numbers or more, a number next to an instant, or one number among gaps, as in a log
    with slow channels."""
    numbers = sum(map(is_number, cells))
    instants = sum(map(is_instant, cells))
    sparse = len(cells) > 2 and numbers + sum(map(is_gap, cells)) == len(cells)
    return numbers > 0 and (numbers + instants >= 2 or sparse)


def _header_above(lines: Sequence[str], body: _Body) -> tuple[list[str], list[str], int]:
    """Names, units, and the line of the names, counted from 1, from the last lines above the rows that may name
    columns."""
    numbered = [(k, cells_of(line, body.separator)) for k, line in enumerate(lines[: body.first]) if line.strip()]
    if body.separator == BLANKS:
        numbered = [(k, _TOKEN.findall(lines[k])) for k, _ in numbered]
    above = [(k, cells) for k, cells in numbered if _may_name(cells, body.width)][-3:]
    if not above:
        return [], [], 0
    for place in range(len(above) - 1, 0, -1):
        (k, names), (_, units) = above[place - 1 : place + 1]
        whole = place == len(above) - 1 or sum(map(bool, names)) >= sum(map(bool, units)) > body.width // 2
        if whole and _are_units(units) and not _are_units(names):
            return names, units, k + 1
    return above[-1][1], [], above[-1][0] + 1


def _may_name(cells: Sequence[str], width: int) -> bool:
    """True for a line without numbers and with as many cells as a row, not counting empty cells at its end."""
    named = len("\0".join(cells).rstrip("\0").split("\0"))
    return any(cells) and named > width // 2 and len(cells) <= width + 1 and not any(map(is_number, cells))


def _are_units(cells: Sequence[str]) -> bool:
    """Whether all cells except one are units, or half of many cells: an ECU has many units that are unknown here."""
    filled = [cell for cell in cells if cell.strip("[]() ")]
    known = sum(map(is_unit_text, filled))
    return bool(filled) and (known >= max(1, len(filled) - 1) or (len(filled) > 3 and 2 * known >= len(filled)))


def _names_in_comments(lines: Sequence[str], body: _Body) -> tuple[list[str], int]:
    """Names in a comment line above the rows, or in a numbered list of comments; and their line."""
    said = [(k + 1, line.strip(_COMMENT_MARKS)) for k, line in enumerate(lines) if is_comment(line)]
    listed = {int(m["number"]): (k, m["name"]) for k, text in said if (m := _NUMBERED.fullmatch(text))}
    start = min(listed, default=0)
    if start in (0, 1) and all(start + k in listed for k in range(body.width)):
        return [listed[start + k][1] for k in range(body.width)], listed[start][0]
    for k, text in reversed(said):
        for cells in (cells_of(text, body.separator), re.split(r"\s{2,}|\t", text), _TOKEN.findall(text)):
            if len(cells) == body.width > 1 and _may_name(cells, body.width):
                return list(cells), k
    return [], 0


def _padded(cells: Sequence[str], width: int) -> tuple[str, ...]:
    return tuple([*cells, *[""] * width][:width])


def _pairs(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    """Lines with a label before each number, and perhaps a unit after it, as rows separated by tabs; None for other
    texts."""

    def are_pairs(line: str) -> bool:
        start = line.lstrip()[:1]  # most texts have no pairs and are not searched
        return (start.isalpha() or start == "_") and not _PAIR.sub("", line).strip()

    found = [(k, _PAIR.findall(line)) for k, line in enumerate(lines) if are_pairs(line)]
    if len(found) < _BLOCK:
        return None
    first, labels, units = found[0][0], *([pair[place] for pair in found[1][1]] for place in (0, 2))
    named = [*zip(labels, units, strict=True)]
    rows = {k: pairs for k, pairs in found if [(label, unit) for label, _, unit in pairs] == named}
    filled = [k for k in range(first, len(lines)) if lines[k].strip() and not is_comment(lines[k])]
    if len(rows) < _BLOCK or len(rows) < 0.9 * len(filled) or len(set(labels)) < len(labels):
        return None
    made = ["\t".join(value for _, value, _ in rows[k]) if k in rows else line for k, line in enumerate(lines)]
    first = min(rows)
    return made, Layout(tuple(labels), tuple(map(str.strip, units)), first + 1, first, "\t",
                        remark="names are the labels before the numbers")  # fmt: skip


def _hp_tuners(lines: Sequence[str], where: str) -> tuple[list[str], Layout]:
    """HP Tuners: ids, names and units below `[Channel Information]`; rows end with the last channel that has a
    reading."""
    stripped = [line.strip() for line in lines[:200]]
    data = stripped.index("[Channel Data]")
    above = [k for k in range(data) if stripped[k]]
    start = next((k for k in above if stripped[k] == "[Channel Information]"), data)
    block = [k for k in above if k > start][:3]
    if len(block) < 2:
        raise MeasurementError(where, "no names below [Channel Information].", "An HP Tuners export has ids, names and "
                               "units there.", "Export it again from VCM Scanner.")  # fmt: skip
    cells = [cells_of(lines[k], ",") for k in block]
    width = max(len(cells[0]), len(cells[-1]))
    names: list[str] = []
    for name in cells[1]:  # a name with commas within brackets is one name
        cut = len(cells[1]) > width and names and names[-1].count("(") > names[-1].count(")")
        names = [*names[:-1], f"{names[-1]},{name}"] if cut else [*names, name]
    units = _padded(cells[2] if len(cells) > 2 else [], width)
    return list(lines), Layout(_padded(names, width), units, block[1] + 1, data + 1, ",", "fill")


def _haltech(lines: Sequence[str], where: str) -> tuple[list[str], Layout]:
    """Haltech: a block of lines for each channel, in the order of the columns; then rows without a header."""
    names, types, head = [], [], 0
    for k, line in enumerate(lines):
        if is_instant(line.partition(",")[0].strip()):
            break
        key, _, value = (part.strip() for part in line.partition(":"))
        if key == "Channel":
            names, types, head = [*names, value], [*types, ""], head or k + 1
        elif key == "Type" and names:
            types[-1] = value
    else:
        raise MeasurementError(where, "no rows of numbers in it.", "A Haltech log has rows that begin with the time.",
                               "Export it again from NSP.")  # fmt: skip
    scaled = [HALTECH.get(each, (1.0, f"counts of {each or 'no type'}")) for each in types]
    return list(lines), Layout(("Time", *names), ("s", *(unit for _, unit in scaled)), head, k, ",", "fill",
                               (1.0, *(scale for scale, _ in scaled)),
                               "whole numbers scaled by their Type, as Haltech's export has them")  # fmt: skip


# (test of the beginning of a text, its layout); any other text has a header above rows
LAYOUTS: tuple[
    tuple[Callable[[Sequence[str]], bool], Callable[[Sequence[str], str], tuple[list[str], Layout]]], ...
] = (
    (lambda lines: lines[0].strip() == "%DataLog%", _haltech),
    (lambda lines: any(line.strip() == "[Channel Data]" for line in lines[:200]), _hp_tuners),
)
