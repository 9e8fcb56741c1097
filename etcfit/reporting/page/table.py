"""A table of the page, whatever it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar


@dataclass(frozen=True)
class Table:
    """Rows under a head.

    Args:
        caption: one line; what the rows are.
        head: names of the columns.
        rows: cells, text or markup, one for each column.
        words: how many of the first columns are words, set to the left.
        marked: rows that stand out, by index.
    """

    # columns of words wherever they stand
    LEFT: ClassVar[tuple[str, ...]] = ("unit", "profile", "status", "met", "meaning", "worst unit", "hardest for it")

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    words: int = 1
    marked: frozenset[int] = frozenset()
