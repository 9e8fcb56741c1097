"""A table between two markers of a page of the documentation."""

from __future__ import annotations

from pathlib import Path


def put(page: Path, report: str, name: str) -> None:
    """The report between the markers of that name.

    Raises:
        SystemExit: the page has none.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, found, rest = page.read_text(encoding="utf-8").partition(begin)
    _, also, after = rest.partition(end)
    if not found or not also:
        raise SystemExit(f"{page}: no lines {begin} and, below, {end}. Write both where the table is to stand.")
    page.write_text(f"{before}{begin}\n\n{report}\n\n{end}{after}", encoding="utf-8")
