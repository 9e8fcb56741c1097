"""A CSV as the programs of ECUs export it -> one that the table reader takes.

    "Format","MoTeC CSV File"       any lines above the header: the last line that names a time, for above it may stand
    "Time","12:21:34"               the time of day
    "Time","Throttle Pos"
    "s","%"                         units below it, where no cell of the row is a number

Line numbers stay those of the file, so that a message names the right one.

Source: files as MoTeC i2 exports them, by the layout that public readers and writers of them agree on: 12 lines of
names and values, two blank ones, header, units, two blank ones, quoted numbers; other programs write fewer lines.
"Time" may stand there twice, in s and in min: the first counts. No file of a real car has been read.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence

from ..rig.table import NUMBER, SEPARATORS

_ABOVE = 200  # lines in which a header is looked for
_TIME = re.compile(r"time(stamp)?\s*([\[(].*[\])])?", re.IGNORECASE)
_WITH_UNIT = re.compile(r".*\[[^\[\]]*\]\s*")


def plain(text: str) -> str:
    """The text without what stands above its header, the units of a row below it taken into it."""
    lines = text.split("\n")
    found = next((k for k in reversed(range(min(_ABOVE, len(lines)))) if _names_a_time(lines[k])), None)
    if found is None:
        return text
    separator = _separator(lines[found])
    header = _cells(lines[found], separator)
    below = next((k for k in range(found + 1, len(lines)) if lines[k].strip()), None)
    units = [] if below is None else _cells(lines[below], separator)
    lines[:found] = [""] * found
    if below is not None and _are_units(units):
        padded = (*units, *[""] * len(header))
        lines[found] = _line([_united(*each) for each in zip(header, padded, strict=False)], separator)
        lines[below] = ""
    return "\n".join(lines)


def _names_a_time(line: str) -> bool:
    return any(_TIME.fullmatch(cell) for cell in _cells(line, _separator(line)))


def _separator(line: str) -> str:
    return max(SEPARATORS, key=line.count)


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _are_units(cells: Sequence[str]) -> bool:
    return any(cells) and not any(NUMBER.fullmatch(cell) for cell in cells)


def _united(name: str, unit: str) -> str:
    return name if not unit or _WITH_UNIT.fullmatch(name) else f"{name} [{unit}]"


def _line(cells: Sequence[str], separator: str) -> str:
    out = io.StringIO()
    csv.writer(out, delimiter=separator, lineterminator="").writerow(cells)
    return out.getvalue()
