"""A table is a value, and so are notes: what a result says is put together once, and every view shows the same.

Table -> terminal (`blocks.shown`), page (`html`, `parts.html`), notebook (`api.views.table`), DataFrame
(`api.views.frame`, of its rows)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from .numbers import short

# a figure stands on the right; a name may show spaces for underscores; prose may fold at spaces, a path at "/"
Kind = Literal["figure", "word", "name", "prose", "path", "symbol", "unit", "hash"]
Tone = Literal["", "bad", "doubt", "dim", "strong"]
_NOTHING: Mapping[str, Kind] = {}


class Cell(NamedTuple):
    """What stands in a cell.

    Args:
        text: as a terminal shows it.
        tone: "bad" is red, and marks the row of a page.
        kind: of its column.
    """

    text: str
    tone: Tone = ""
    kind: Kind = "figure"


class Column(NamedTuple):
    """A column: its name, and what of a row it shows.

    Args:
        head: name; a line end goes before its unit.
        show: key of the row (its place, where rows are sequences), or a function of the row.
        kind: of its cells.
        spare: may be left out where there is no room, 1 first; 0: never.
        digits: significant ones of a number.
    """

    head: str
    show: str | int | Callable[[Any], Any]
    kind: Kind = "figure"
    spare: int = 0
    digits: int = 3

    def cell(self, row: Any) -> Cell:
        """Of one row."""
        value = self.show(row) if callable(self.show) else row[self.show]
        if isinstance(value, Cell):
            return value._replace(kind=self.kind)
        return Cell(text_of(value, self.digits), kind=self.kind)


@dataclass(frozen=True)
class Table:
    """Rows under a head.

    Args:
        title: what the rows are.
        columns: see `Column`.
        rows: records in SI, or sequences of what is shown.
        notes: sentences below it.
        keys: so many columns say what a row is of; they are repeated where columns go on below.
        file: that holds what is left out as well, or "".
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Any]
    notes: Sequence[str] = ()
    keys: int = 1
    file: str = ""

    @property
    def cells(self) -> list[list[Cell]]:
        return [[column.cell(row) for column in self.columns] for row in self.rows]

    @property
    def texts(self) -> list[dict[str, str]]:
        """What each row shows, by head."""
        return [{column.head: cell.text for column, cell in zip(self.columns, row, strict=True)} for row in self.cells]


def of_texts(
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[Any]],
    words: int = 1,
    kinds: Mapping[str, Kind] = _NOTHING,
    spare: Sequence[str] = (),
    **how: Any,
) -> Table:
    """A table of what is text already.

    Args:
        title, rows: see `Table`.
        heads: of the columns.
        words: so many columns at the left are words and say what a row is of; the others are figures.
        kinds: of other columns, by head.
        spare: heads of those that may be left out, the one that goes first in front.
        how: of `Table`.
    """
    order = {head: k for k, head in enumerate(spare, start=1)}
    columns = [Column(head, k, kinds.get(head, "word" if k < words else "figure"), order.get(head, 0))
               for k, head in enumerate(heads)]  # fmt: skip
    return Table(title, columns, rows, keys=max(words, 1), **how)


@dataclass(frozen=True)
class Notes:
    """Sentences under a title; lines of code, to be pasted as they are, where `code`."""

    title: str
    texts: Sequence[str]
    code: bool = False


Part = Table | Notes


def role(held_out: bool) -> str:
    """Of a trace."""
    return "held out" if held_out else "fitted"


def there(*parts: Part | None) -> list[Part]:
    """Those that hold anything."""
    return [part for part in parts if part is not None and (part.rows if isinstance(part, Table) else part.texts)]


def text_of(value: Any, digits: int = 3) -> str:
    """Text as it is, yes or no, whole numbers whole, others to a few digits; "-" for what is not known."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int) else short(value, digits)
