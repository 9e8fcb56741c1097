"""A table between two markers of a page of the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class Between(NamedTuple):
    """The two lines between which a table stands."""

    begin: str
    end: str

    @classmethod
    def named(cls, name: str) -> Between:
        """Those of a table's name."""
        return cls(f"<!-- {name}: begin -->", f"<!-- {name}: end -->")

    def must_be_in(self, page: Path) -> None:
        """Refuse a page that is there and has no place for the table.

        Raises:
            SystemExit: it has none.
        """
        if page.exists() and self.end not in page.read_text(encoding="utf-8").partition(self.begin)[2]:
            raise SystemExit(f"{page}: no lines {self.begin} and, below, {self.end}. "
                             "Write both where the table is to stand.")  # fmt: skip

    def filled(self, text: str, report: str) -> str:
        """The text of a page with the report between the markers."""
        before, _, rest = text.partition(self.begin)
        return f"{before}{self.begin}\n\n{report}\n\n{self.end}{rest.partition(self.end)[2]}"

    def put(self, page: Path, report: str) -> None:
        """The report between them, on the page or on a new one.

        Raises:
            SystemExit: the page has no place for it.
        """
        self.must_be_in(page)
        text = page.read_text(encoding="utf-8") if page.exists() else f"{self.begin}\n{self.end}\n"
        page.write_text(self.filled(text, report), encoding="utf-8")
