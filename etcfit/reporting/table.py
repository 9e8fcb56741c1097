"""Tables and notes as values: the output of a result is made once, and every view shows the same.

Table -> terminal (`blocks.shown`), page (`html`, `parts.html`), notebook (`api.views.table`), DataFrame
(`api.views.frame`, of its rows)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from .numbers import short

# a figure is right-aligned; a name may show spaces for underscores; prose may break at spaces, a path at "/"
Kind = Literal["figure", "word", "name", "prose", "path", "symbol", "unit", "hash"]
Tone = Literal["", "bad", "doubt", "dim", "strong"]
_NOTHING: Mapping[str, Kind] = {}


class Cell(NamedTuple):
    """The content of a cell."""

    text: str  # text for a terminal
    tone: Tone = ""  # "bad" is red, and marks the row of a page
    kind: Kind = "figure"  # kind of its column


class Column(NamedTuple):
    """A column: its name, and the part of a row that it shows."""

    head: str  # name; a line end goes before its unit
    show: str | int | Callable[[Any], Any]  # key of the row (an index if rows are sequences), or a function of the row
    kind: Kind = "figure"  # kind of its cells
    spare: int = 0  # order in which columns are left out if space is scarce, 1 first; 0: never
    digits: int = 3  # significant digits of a number

    def cell(self, row: Any) -> Cell:
        """The cell of one row."""
        value = self.show(row) if callable(self.show) else row[self.show]
        if isinstance(value, Cell):
            return value._replace(kind=self.kind)
        return Cell(text_of(value, self.digits), kind=self.kind)


@dataclass(frozen=True)
class Table:
    """Rows under a head."""

    title: str  # what the rows are
    columns: Sequence[Column]  # see `Column`
    rows: Sequence[Any]  # records in SI, or sequences of shown values
    notes: Sequence[str] = ()  # sentences below it
    keys: int = 1  # number of first columns that identify a row; they are repeated if columns continue below
    file: str = ""  # file that also has the omitted columns, or ""

    @property
    def cells(self) -> list[list[Cell]]:
        return [[column.cell(row) for column in self.columns] for row in self.rows]

    @property
    def texts(self) -> list[dict[str, str]]:
        """The shown values of each row, by head."""
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
    """A table of texts.

    Args:
        title, rows: see `Table`.
        words: number of columns at the left with words, which identify a row; the others are figures.
        kinds: kinds of other columns, by head.
        spare: heads of optional columns, in the order in which they are left out.
        how: further arguments of `Table`.
    """
    order = {head: k for k, head in enumerate(spare, start=1)}
    columns = [Column(head, k, kinds.get(head, "word" if k < words else "figure"), order.get(head, 0))
               for k, head in enumerate(heads)]  # fmt: skip
    return Table(title, columns, rows, keys=max(words, 1), **how)


@dataclass(frozen=True)
class Notes:
    """Sentences under a title; with `code`, lines of code to paste."""

    title: str
    texts: Sequence[str]
    code: bool = False


Part = Table | Notes


def role(held_out: bool) -> str:
    """Role of a trace."""
    return "held out" if held_out else "fitted"


def there(*parts: Part | None) -> list[Part]:
    """Tables and notes that are not empty."""
    return [part for part in parts if part is not None and (part.rows if isinstance(part, Table) else part.texts)]


def text_of(value: Any, digits: int = 3) -> str:
    """Text unchanged, yes or no, whole numbers in full, others to a few digits; "-" if not known."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int) else short(value, digits)
